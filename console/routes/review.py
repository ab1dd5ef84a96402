"""The review's scene and cursor: a page names itself by a key, `view`, and moves the arms of its own scene."""

import asyncio
import contextlib
import re
from typing import Any

from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.exceptions import HTTPException
from fastapi.responses import Response
from pydantic import BaseModel, Field, ValidationError
from starlette.concurrency import run_in_threadpool

from console.parts import NeedsParts, Parts, parts_of, session_now
from console.review.columns import ColumnsGone
from console.review.logs import NotReviewable, ReadLog, opened, wanted_signals
from console.review.scene import Pose, Poses
from console.review.series import moment
from console.routes.scene import pass_on_page, pass_on_stream
from console.scenes import Detail
from rtstack.messages import MESSAGE, StrictFloat

router = APIRouter(include_in_schema=False)  # files and streams

_VIEW = re.compile(r"[A-Za-z0-9-]{8,64}")


class Cursor(BaseModel):
    """Where a page's cursor is: s after the log's first sample, and what it wants to read there.

    other: id of a second log, shown as a ghost; offset: of its time, s: what it had at t - offset is shown at t.
    """

    model_config = MESSAGE

    t: StrictFloat = Field(ge=-1e9, le=1e9)
    signals: str = Field(default="", max_length=8192)
    other: str = Field(default="", max_length=128)
    offset: StrictFloat = Field(default=0.0, ge=-1e9, le=1e9)


@router.get("/viser/review/{detail}/{view}/{path:path}")
async def page(detail: Detail, view: str, path: str, request: Request, parts: NeedsParts) -> Response:
    """Pass on a file of the review scene's page."""
    _check(view)
    return await pass_on_page(await run_in_threadpool(parts.review_scenes.server, detail), path, request)


@router.websocket("/viser/review/{detail}/{view}")
async def stream(websocket: WebSocket, detail: Detail, view: str) -> None:
    """Connect a page with its scene."""
    if not _VIEW.fullmatch(view):
        await websocket.close(1008, "not a view")
        return
    await pass_on_stream(await run_in_threadpool(parts_of(websocket).review_scenes.server, detail), websocket, view)


@router.websocket("/api/logs/{log_id}/scrub")
async def scrub(websocket: WebSocket, log_id: str, view: str) -> None:
    """Take cursors as JSON, {"t": s, "signals": "a,b"}; show the newest one in the scene, then answer what is there.

    Cursors that arrive meanwhile are passed over: a page that drags is never behind.
    """
    parts = parts_of(websocket)
    await websocket.accept()
    newest: asyncio.Queue[str] = asyncio.Queue()
    listening = asyncio.create_task(_listen(websocket, newest))
    try:
        while True:
            waiting = asyncio.create_task(newest.get())
            await asyncio.wait([waiting, listening], return_when=asyncio.FIRST_COMPLETED)
            if not waiting.done():
                waiting.cancel()
                return
            text = waiting.result()
            while not newest.empty():
                text = newest.get_nowait()
            if session_now(websocket) is None:
                await websocket.close(1008, "not signed in any more")
                return
            await websocket.send_json(await run_in_threadpool(_answer, parts, log_id, view, text))
    except (WebSocketDisconnect, RuntimeError):
        pass  # the page has gone
    finally:
        listening.cancel()


async def _listen(websocket: WebSocket, newest: asyncio.Queue[str]) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, KeyError):
        while True:
            newest.put_nowait(await websocket.receive_text())


def _answer(parts: Parts, log_id: str, view: str, text: str) -> dict[str, Any]:
    """Return the answer."""
    try:
        cursor = Cursor.model_validate_json(text)
        read = _read(parts, log_id)
        found = moment(read.folder, read.index, wanted_signals(cursor.signals), cursor.t)
        pose = Pose(found.q, _object_name(read.entry.trial), found.object)
        ghost = None
        if cursor.other:
            other = _read(parts, cursor.other)
            there = moment(other.folder, other.index, wanted_signals(cursor.signals), cursor.t - cursor.offset)
            ghost = Pose(there.q, _object_name(other.entry.trial), there.object)
    except ValidationError as error:
        return {"error": str(error.errors()[0]["msg"])}
    except (NotReviewable, ColumnsGone) as error:
        return {"error": str(error)}
    shown = parts.review_scenes.show(view, Poses(pose, ghost)) if _VIEW.fullmatch(view) else 0
    answer = {"t": cursor.t, "sample_t": found.t_s, "values": found.values, "scenes": shown}
    return answer if ghost is None else answer | {"ghost_t": there.t_s, "ghost_values": there.values}


def _read(parts: Parts, log_id: str) -> ReadLog:
    """Return a log of which something has been read. Raises NotReviewable, ColumnsGone."""
    read = opened(parts.catalogue, parts.review_cache, log_id)
    if read is None:
        raise NotReviewable(409, "nothing of this log has been read yet")
    return read


def _object_name(trial: Any) -> str:
    return str((trial or {}).get("object", ""))


def _check(view: str) -> None:
    if not _VIEW.fullmatch(view):
        raise HTTPException(404, "not a view: eight to 64 letters, digits and hyphens")
