"""The live feed's WebSocket for Foxglove, and its address. The guard has let in who knows the address."""

import asyncio
import contextlib
from dataclasses import dataclass

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from starlette.concurrency import run_in_threadpool

from console.feed import PERIOD_S, SUBPROTOCOLS, Feed, server_info
from console.guard import FEED_PREFIX
from console.parts import NeedsParts, NeedsSession, parts_of, session_now
from rtstack.trials.record import frames

router = APIRouter(tags=["robot"])

_MAX_CLIENTS = 4
_clients: set[WebSocket] = set()


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
    listening = asyncio.create_task(_listen(websocket, live))
    try:
        await websocket.send_text(server_info(parts.cell.name))
        await websocket.send_text(live.advertisement())
        while not listening.done():
            if session_now(websocket) is None:
                await websocket.close(1008, "the session of this address has signed out")
                break
            for message in await run_in_threadpool(live.poll):
                await websocket.send_bytes(message)
            await asyncio.sleep(PERIOD_S)
    except (WebSocketDisconnect, RuntimeError):
        pass  # it has gone
    finally:
        _clients.discard(websocket)
        listening.cancel()


async def _listen(websocket: WebSocket, live: Feed) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, KeyError):
        while True:
            live.hear(await websocket.receive_text())
