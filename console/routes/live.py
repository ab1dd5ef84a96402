"""The live state, pushed to the page 20 times a second, and the events behind it."""

import asyncio
import contextlib
from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from console.parts import NeedsParts, parts_of

router = APIRouter()

_PERIOD_S = 0.05


@router.websocket("/live")
async def live(websocket: WebSocket) -> None:
    """Push the live view until the page closes."""
    watch = parts_of(websocket).watch
    await websocket.accept()
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await websocket.send_json(watch.view.as_document())
            await asyncio.sleep(_PERIOD_S)


@router.get("/api/events")
def events(parts: NeedsParts) -> list[dict[str, Any]]:
    """Return the newest events, oldest first."""
    return [asdict(event) for event in parts.watch.events()]
