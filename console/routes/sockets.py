"""What WebSockets have in common: a client that sends texts while it is sent something."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from fastapi import WebSocket, WebSocketDisconnect

SIGNED_OUT = 1008, "not signed in any more"


@asynccontextmanager
async def listening(websocket: WebSocket, hear: Callable[[str], None]) -> AsyncIterator["asyncio.Task[None]"]:
    """Hand each text of a client to `hear` while the block sends to it; a client that has gone ends the block.

    Gives the task that listens, which is done once the client has gone.
    """

    async def listen() -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            async for text in websocket.iter_text():
                hear(text)

    task = asyncio.create_task(listen())
    try:
        yield task
    except (WebSocketDisconnect, RuntimeError):
        pass  # the client has gone
    finally:
        task.cancel()
