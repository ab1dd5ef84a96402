"""The 3D scene, proxied from a viser server that only we can reach, and the trial that it shows.

HTTP at /viser/DETAIL/, WebSocket at /viser/DETAIL: viser's client finds the one from the other.
"""

import asyncio
import contextlib
from typing import Annotated, Any
from urllib.parse import quote

import httpx
import msgspec
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.exceptions import HTTPException
from fastapi.responses import RedirectResponse, Response
from pydantic import Field
from pydantic.dataclasses import dataclass as checked
from starlette.concurrency import run_in_threadpool
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from console.orders import TrialOrder
from console.parts import NeedsParts, NeedsSession, Parts, parts_of, session_now
from console.scene.experiment import TrialPlan
from console.scene.scenes import Detail
from console.scene.server import SECRET_HEADER, VIEW_HEADER, SceneServer
from console.templates import static
from hal.displacement import Displacement
from rtstack.access.tokens import Scope
from rtstack.log.errors import LogError
from rtstack.log_folder.log_rows import NoReference, reference_of
from rtstack.messages import MESSAGE
from rtstack.trials.specification import DisplacementMm, ObjectName, YawDeg

router = APIRouter(include_in_schema=False)

_PASSED_ON = ("content-type", "content-encoding", "content-length")
_LONGEST_NAME = 255  # of a file
_MAX_MESSAGE_BYTES = 1 << 20  # from a page: camera poses and clicks are far smaller
_FOR_EVERYBODY = frozenset({"ViewerCameraMessage"})
_FOR_THE_HOLDER = frozenset(
    {"TransformControlsUpdateMessage", "TransformControlsDragStartMessage", "TransformControlsDragEndMessage"}
)


class _Kind(msgspec.Struct):
    type: str


def lets_through(message: bytes, holder: bool) -> bool:
    """Whether a message of viser's client may pass; holder: whether its session has control. Others may not."""
    try:
        kind = msgspec.msgpack.decode(message, type=_Kind).type
    except msgspec.MsgspecError:
        return False
    return kind in _FOR_EVERYBODY or (holder and kind in _FOR_THE_HOLDER)


@checked(frozen=True, slots=True, config=MESSAGE)
class PlanShown:
    """What the form of a trial says; without an object: no form is shown. See TrialOrder."""

    object: ObjectName | None = None
    reference: Annotated[str, Field(max_length=128)] = ""
    displacement_mm: DisplacementMm = 0.0
    displacement_x_mm: DisplacementMm = 0.0
    yaw_deg: YawDeg = 0.0


@router.post("/api/scene/plan")
def show_plan(shown: PlanShown, session: NeedsSession, parts: NeedsParts) -> dict[str, bool]:
    """Draw what a form says in the live scene, for all who look. Where an operator has control, only theirs: drawn."""
    status = parts.watch.view.status
    if status is not None and status.holder not in (None, session.operator):
        return {"drawn": False}  # a page that has not heard of it yet: no error of its own
    parts.scenes.plans.set(None if shown.object is None else plan_of(parts, shown, shown.object))
    return {"drawn": True}


@router.post("/api/scene/ghost/end")
def end_ghost(parts: NeedsParts) -> None:
    """Show no preview and no replay any more."""
    parts.scenes.ghost.end()


def plan_of(parts: Parts, order: PlanShown | TrialOrder, object_name: str) -> TrialPlan:
    """Return what the scene draws of an order. A reference that is not there is left out."""
    put = Displacement.given(order.displacement_mm, order.displacement_x_mm, order.yaw_deg)
    try:
        reference = reference_of(parts.catalogue, order.reference).path if order.reference else None
    except (NoReference, LogError):
        reference = None
    return TrialPlan(object_name, put, reference)


@router.get("/viser/{detail}")
def without_slash(detail: Detail) -> RedirectResponse:
    """Send a browser to the page itself: its script finds its WebSocket by the address."""
    return RedirectResponse(f"/viser/{detail}/")


@router.get("/viser/{detail}/{path:path}")
async def page(detail: Detail, path: str, request: Request, parts: NeedsParts) -> Response:
    """Pass on a file of the scene's page."""
    return await pass_on_page(await run_in_threadpool(parts.scenes.server, detail), path, request)


@router.websocket("/viser/{detail}")
async def stream(websocket: WebSocket, detail: Detail) -> None:
    """Pass messages on in both directions until one side closes."""
    await pass_on_stream(await run_in_threadpool(parts_of(websocket).scenes.server, detail), websocket)


async def pass_on_page(server: SceneServer, path: str, request: Request) -> Response:
    """Answer with a file of a scene server's page."""
    whole = path == ""  # viser's page, which our script goes into
    encoding = "identity" if whole else request.headers.get("accept-encoding", "identity")
    headers = {SECRET_HEADER: server.secret, "accept-encoding": encoding}
    name = quote(path)
    if not path.isprintable() or len(name) > _LONGEST_NAME:
        raise HTTPException(404, "the scene has no such file")
    async with (
        httpx.AsyncClient(trust_env=False, verify=False) as client,  # plain HTTP: no certificates to load
        client.stream("GET", f"http://127.0.0.1:{server.port}/{name}", headers=headers) as answer,
    ):
        body = b"".join([part async for part in answer.aiter_raw()])  # as it was packed
        passed_on = {name: answer.headers[name] for name in _PASSED_ON if name in answer.headers}
        if whole:
            pace = f'<head><script src="{static()}/js/scene_pace.js"></script>'  # before viser's own script
            body = body.replace(b"<head>", pace.encode(), 1)
            passed_on["content-length"] = str(len(body))
        return Response(body, status_code=answer.status_code, headers=passed_on)


async def pass_on_stream(server: SceneServer, websocket: WebSocket, view: str = "") -> None:
    """Connect a page with a scene server until one side closes; `view` is what the page is called there."""
    wanted = [Subprotocol(name) for name in websocket.scope.get("subprotocols", [])] or None
    address, headers = f"ws://127.0.0.1:{server.port}/", {SECRET_HEADER: server.secret, VIEW_HEADER: view}
    plain: dict[str, Any] = {"max_size": None, "compression": None, "proxy": None}
    try:
        async with connect(address, subprotocols=wanted, additional_headers=headers, **plain) as scene:
            await websocket.accept(subprotocol=scene.subprotocol)
            ways = _to_scene(websocket, scene, parts_of(websocket)), _to_page(scene, websocket)
            tasks = [asyncio.create_task(way) for way in ways]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
    except (OSError, WebSocketException):
        pass
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page may have gone first
        await websocket.close()


async def _to_scene(page: WebSocket, scene: ClientConnection, parts: Parts) -> None:
    with contextlib.suppress(WebSocketDisconnect, ConnectionClosed, KeyError):
        while True:
            message = await page.receive_bytes()
            session, status = session_now(page), parts.watch.view.status
            if session is None:
                return
            holder = status is not None and session.operator == status.holder and session.scope is Scope.OPERATE
            if len(message) <= _MAX_MESSAGE_BYTES and lets_through(message, holder):
                await scene.send(message)


async def _to_page(scene: ClientConnection, page: WebSocket) -> None:
    with contextlib.suppress(WebSocketDisconnect, ConnectionClosed, RuntimeError):
        async for message in scene:
            if session_now(page) is None:
                return
            await page.send_bytes(message if isinstance(message, bytes) else message.encode())
