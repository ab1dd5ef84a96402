"""The review's scene and cursor: a page names itself by a key, `view`, and moves the arms of its own scene."""

import asyncio
import re
from typing import Any

from fastapi import APIRouter, Request, WebSocket
from fastapi.exceptions import HTTPException
from fastapi.responses import Response
from pydantic import BaseModel, Field, ValidationError
from starlette.concurrency import run_in_threadpool

from console.parts import NeedsParts, Parts, parts_of, session_now
from console.refused import Refused
from console.review.figure import overlays_of
from console.review.logs import ReadLog, begun, wanted_signals
from console.review.scene import Pose, Poses
from console.review.series import Moment, moment
from console.routes.scene import pass_on_page, pass_on_stream
from console.routes.sockets import SIGNED_OUT, listening
from console.scene.scenes import Detail
from rtstack.messages import MESSAGE, StrictFloat

router = APIRouter(include_in_schema=False)  # files and streams

_VIEW = re.compile(r"[A-Za-z0-9-]{8,64}")


class Cursor(BaseModel):
    """Where a page's cursor is: s after the log's first sample, and what it wants to read there.

    others: ID:OFFSET of each log over it, s: what it had at t - offset is read at t; ghost: the first is in the scene.
    """

    model_config = MESSAGE

    t: StrictFloat = Field(ge=-1e9, le=1e9)
    signals: str = Field(default="", max_length=8192)
    others: str = Field(default="", max_length=1024)
    ghost: bool = True


@router.get("/viser/review/{detail}/{view}/{path:path}")
async def page(detail: Detail, view: str, path: str, request: Request, parts: NeedsParts) -> Response:
    """Pass on a file of the review scene's page."""
    if not _VIEW.fullmatch(view):
        raise HTTPException(404, "not a view: eight to 64 letters, digits and hyphens")
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
    """Take cursors as JSON; show the newest one in the scene, then answer what is there. Others are passed over."""
    parts = parts_of(websocket)
    await websocket.accept()
    newest: asyncio.Queue[str] = asyncio.Queue()
    async with listening(websocket, newest.put_nowait) as client:
        while True:
            waiting = asyncio.create_task(newest.get())
            await asyncio.wait([waiting, client], return_when=asyncio.FIRST_COMPLETED)
            if not waiting.done():
                waiting.cancel()
                return
            text = waiting.result()
            while not newest.empty():
                text = newest.get_nowait()
            if session_now(websocket) is None:
                await websocket.close(*SIGNED_OUT)
                return
            await websocket.send_json(await run_in_threadpool(_answer, parts, log_id, view, text))


def _answer(parts: Parts, log_id: str, view: str, text: str) -> dict[str, Any]:
    try:
        cursor = Cursor.model_validate_json(text)
        read = begun(parts.catalogue, parts.review_cache, log_id)
        asked = overlays_of(cursor.others)
        others = [begun(parts.catalogue, parts.review_cache, other) for other, _ in asked]
        wanted = wanted_signals(cursor.signals, read, *others)
        found = moment(read, wanted, cursor.t)
        there = [moment(other, wanted, cursor.t - offset_s) for other, (_, offset_s) in zip(others, asked, strict=True)]
        ghost = _pose(there[0], others[0]) if there and cursor.ghost else None
    except ValidationError as error:
        return {"error": str(error.errors()[0]["msg"])}
    except Refused as error:
        return {"error": str(error)}
    shown = parts.review_scenes.show(view, Poses(_pose(found, read), ghost)) if _VIEW.fullmatch(view) else 0
    compared = [{"t": other.t_s, "values": other.values} for other in there]
    return {"t": cursor.t, "sample_t": found.t_s, "values": found.values, "scenes": shown, "others": compared}


def _pose(found: Moment, log: ReadLog) -> Pose:
    return Pose(found.q, str((log.entry.trial or {}).get("object", "")), found.object, found.sides)
