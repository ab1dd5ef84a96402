"""The robot: its status, its modes' names; the live state, pushed to the page 20 times a second, and its answers.

A page answers each view that it has shown: that is its operator's sign of life, without a timer. STOP comes by this
way, too: it is open already where a new connection has to wait.
"""

import asyncio
from dataclasses import dataclass

import msgspec
from fastapi import APIRouter, WebSocket
from starlette.concurrency import run_in_threadpool

from console.guard import FEED_PREFIX
from console.live.feed import PERIOD_S, SUBPROTOCOLS, Feed, server_info
from console.live.watch import EventView
from console.parts import NeedsParts, NeedsSession, parts_of, session_now
from console.routes.control import report_stop
from console.routes.problems import problems
from console.routes.sockets import SIGNED_OUT, listening
from rtstack.live.protocol import Status
from rtstack.palette import MODE_STYLES
from rtstack.trials.record import frames

router = APIRouter(tags=["robot"])
_UNREACHABLE = problems(503)

_PERIOD_S = 0.05
_MAX_CLIENTS = 4  # Foxglove's
_clients: set[WebSocket] = set()
BEAT = "beat"
ASLEEP, AWAKE = "asleep", "awake"  # of a page that the browser freezes; it reads nothing meanwhile
STOP, REPORT_STOP = "stop", "report stop"  # the second one where a page's request did not get through
_MAX_REPORTS = 1000  # of one page


@dataclass(frozen=True, slots=True)
class ModeInfo:
    """A mode of the controller: its name in the live state and in logs, its word on pages, what it means, its colour,
    and that on a light ground.
    """

    name: str
    word: str
    meaning: str
    colour: str
    light: str


@router.get("/api/modes", responses=_UNREACHABLE)
def modes() -> list[ModeInfo]:
    """Return every mode, as pages write and colour it."""
    return [ModeInfo(s.mode.name, s.word, s.meaning, s.colour, s.light) for s in MODE_STYLES.values()]


@router.get("/api/status", responses=_UNREACHABLE)
def status(parts: NeedsParts) -> Status:
    """Return how the robot process is."""
    return parts.client.status()


@router.websocket("/live")
async def live(websocket: WebSocket) -> None:
    """Push the live view, and as whom this session acts (`you`), until the page closes."""
    parts = parts_of(websocket)
    watch, ghost = parts.watch, parts.scenes.ghost

    reports: list[asyncio.Task[None]] = []
    awake = asyncio.Event()
    awake.set()

    def hear(message: str) -> None:
        session = session_now(websocket)
        if session is None:
            return
        if message == BEAT:
            parts.heartbeats.note(session.operator)
        elif message in (ASLEEP, AWAKE):
            (awake.set if message == AWAKE else awake.clear)()
        elif message == STOP:
            parts.mailbox.request_stop()
        elif message == REPORT_STOP and len(reports) < _MAX_REPORTS:
            reports.append(asyncio.create_task(report_stop(parts, session)))

    await websocket.accept()
    async with listening(websocket, hear) as client:
        while (session := session_now(websocket)) is not None:
            if not awake.is_set():  # the browser answers the connection's pings (console/server.py) for its page
                wakes = asyncio.ensure_future(awake.wait())
                with parts.heartbeats.asleep(session.operator):
                    await asyncio.wait((client, wakes), return_when=asyncio.FIRST_COMPLETED)
                wakes.cancel()
            status = watch.view.status
            ghost.watch(status)
            own = msgspec.json.encode({
                "you": session.operator, "hand": parts.teleop.view, "ghost": ghost.view,
                "request": parts.request.view(status and status.holder),
            })  # fmt: skip
            # waits for a page that does not keep up: it is sent the newest view next, and none in between
            await websocket.send_text((watch.document[:-1] + b"," + own[1:]).decode())
            await asyncio.sleep(_PERIOD_S)
        await websocket.close(*SIGNED_OUT)


@router.get("/api/events")
def events(parts: NeedsParts) -> list[EventView]:
    """Return the newest events, oldest first."""
    return list(parts.watch.events())


@dataclass(frozen=True, slots=True)
class FeedAddress:
    """What Foxglove is told to open."""

    address: str


@router.get("/api/foxglove")
def address(session: NeedsSession, parts: NeedsParts) -> FeedAddress:
    """Return the address that Foxglove connects to. It allows viewing while the session that asks lasts."""
    return FeedAddress(f"{parts.sign_in.address.base.replace('http', 'ws', 1)}{FEED_PREFIX}{session.feed}")


@router.websocket(FEED_PREFIX + "{feed}")
async def foxglove(websocket: WebSocket, feed: str) -> None:
    """Send what the client subscribes to, until it goes."""
    chosen = next((name for name in SUBPROTOCOLS if name in websocket.scope.get("subprotocols", [])), None)
    if chosen is None or len(_clients) >= _MAX_CLIENTS:
        await websocket.close(1008, "not Foxglove's protocol" if chosen is None else "too many are watching")
        return
    parts = parts_of(websocket)
    await websocket.accept(subprotocol=chosen)
    live = Feed(parts.watch.rings, frames(parts.cell, next(iter(parts.cell.objects))))
    _clients.add(websocket)
    try:
        async with listening(websocket, live.hear) as client:
            await websocket.send_text(server_info(parts.cell.name))
            await websocket.send_text(live.advertisement())
            while not client.done():
                if session_now(websocket) is None:
                    await websocket.close(1008, "the session of this address has signed out")
                    break
                for message in await run_in_threadpool(live.poll):
                    await websocket.send_bytes(message)
                await asyncio.sleep(PERIOD_S)
    finally:
        _clients.discard(websocket)
