"""A WebSocket to a console, for a program that waits for each answer.

All of it is read and written in one thread: OpenSSL's connections may not be shared by two, and a client that reads in
one and writes in the other loses one connection of twenty over HTTPS as it opens (python/cpython#143756).
"""

import asyncio
import ssl
import threading
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from websockets.asyncio.client import ClientConnection, connect

T = TypeVar("T")


class Stream:
    """Messages to a console, and its answers. Raises websockets' WebSocketException, or OSError."""

    def __init__(self, connection: ClientConnection, loop: asyncio.AbstractEventLoop) -> None:
        self._connection, self._loop = connection, loop

    def send(self, message: str) -> None:
        """Send a message."""
        _wait(self._connection.send(message), self._loop)

    def recv(self, timeout_s: float) -> str | bytes:
        """Return the next message. Raises TimeoutError where none comes in time."""
        return _wait(asyncio.wait_for(self._connection.recv(), timeout_s), self._loop)


@contextmanager
def open_stream(address: str, headers: Mapping[str, str], tls: ssl.SSLContext) -> Iterator[Stream]:
    """Give a stream to ws://... or wss://...; closing it lets go. tls: who is trusted, over wss.

    Raises websockets' WebSocketException, or OSError.
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="stream", daemon=True)
    thread.start()
    try:
        connection = _wait(_connect(address, headers, tls if address.startswith("wss") else None), loop)
        try:
            yield Stream(connection, loop)
        finally:
            _wait(connection.close(), loop)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _connect(address: str, headers: Mapping[str, str], tls: ssl.SSLContext | None) -> ClientConnection:
    return await connect(address, additional_headers=headers, proxy=None, ssl=tls)


def _wait(work: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop) -> T:
    return asyncio.run_coroutine_threadsafe(work, loop).result()
