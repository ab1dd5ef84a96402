"""The live state, pushed to the page 20 times a second, its answers, and the events behind it.

A page answers each view that it has shown: that is its operator's sign of life. It needs no timer, which a browser
slows down in a hidden tab, and a page that is closed, frozen or broken gives none.
"""

import asyncio
import contextlib

import msgspec
from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from console.parts import NeedsParts, parts_of, session_now
from console.watch import EventView

router = APIRouter(tags=["robot"])

_PERIOD_S = 0.05
BEAT = "beat"


@router.websocket("/live")
async def live(websocket: WebSocket) -> None:
    """Push the live view, and as whom this session acts (`you`), until the page closes."""
    parts = parts_of(websocket)
    watch = parts.watch
    await websocket.accept()
    listening = asyncio.create_task(_listen(websocket))
    try:
        while (session := session_now(websocket)) is not None:
            ghost = parts.scenes.ghost
            ghost.watch(watch.view.status)
            own = msgspec.json.encode({"you": session.operator, "hand": parts.teleop.view, "ghost": ghost.view})
            # waits for a page that does not keep up: it is sent the newest view next, and none in between
            await websocket.send_text((watch.document[:-1] + b"," + own[1:]).decode())
            await asyncio.sleep(_PERIOD_S)
        await websocket.close(1008, "not signed in any more")
    except (WebSocketDisconnect, RuntimeError):
        pass  # the page has gone
    finally:
        listening.cancel()


async def _listen(websocket: WebSocket) -> None:
    heartbeats = parts_of(websocket).heartbeats
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        async for message in websocket.iter_text():
            session = session_now(websocket)
            if message == BEAT and session is not None:
                heartbeats.note(session.operator)


@router.get("/api/events")
def events(parts: NeedsParts) -> list[EventView]:
    """Return the newest events, oldest first."""
    return list(parts.watch.events())
