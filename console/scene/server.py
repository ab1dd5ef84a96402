"""A viser server that only our proxy can reach: loopback, a free port, and a secret header on every request.

viser 1.1.1 has no sign-in and no Origin check of its own, so its port is guarded where its WebSocket server is made.
It packs every window of messages for each page anew, which is most of what a viewer costs; here it is packed once for
all pages that keep up, in the form of viser.infra._infra._message_producer, whose place this takes.
"""

import contextlib
import hmac
import io
import logging
import secrets
import socket
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from http import HTTPStatus
from typing import Any

import msgspec
import viser
import websockets.asyncio.server
import zstandard
from viser import _messages
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from viser.infra._messages import Message
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from console.connections import AT_ONCE, Door, welcome

_STRANGERS = 16  # connections without the secret at a time: nothing but the proxy has to connect here
_KEPT = 8  # windows: pages are at most a few of them apart


class Packing:
    """Packs windows, and keeps the newest ones. Used in one thread, a server's own."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, ...], tuple[Sequence[Message], bytes]] = OrderedDict()
        self._compressor = zstandard.ZstdCompressor(level=1)

    def packed(self, window: Sequence[Message]) -> bytes:
        """Return a window as the page's script takes it; the same messages give the same bytes."""
        key = tuple(map(id, window))  # of messages that are kept with the bytes, so that no id is given anew
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = window, self._pack(window)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return kept[1]

    def _pack(self, window: Sequence[Message]) -> bytes:
        buffers: list[memoryview] = []
        messages = tuple(message.as_serializable_dict(buffers) for message in window)
        sizes = tuple(buffer.nbytes for buffer in buffers)
        content = {"messages": messages, "timestampSec": time.perf_counter(), "binaryBufferLengths": sizes}
        inner = msgspec.msgpack.encode(content)
        compressed = self._compressor.compress(inner)
        lengths = (len(inner).to_bytes(8, "little"), len(compressed).to_bytes(8, "little"))
        parts: list[bytes | memoryview] = [*lengths, compressed]
        _infra._append_aligned_buffers(parts, buffers, 16 + len(compressed))
        return b"".join(parts)


async def _produce(
    websocket: ServerConnection, buffer: AsyncMessageBuffer, client_id: int, backlog_done_message: Message | None = None
) -> None:
    """Send a page the windows of a buffer until it is closed."""
    packing = buffer.__dict__.setdefault("packing", Packing())
    windows = buffer.window_generator(client_id, backlog_done_message=backlog_done_message)
    try:
        async for window in windows:
            await websocket.send(packing.packed(window))
    finally:
        await windows.aclose()  # now, and not when it is collected: it holds a cursor of the buffer


SECRET_HEADER = "x-rtstack-scene"
VIEW_HEADER = "x-rtstack-view"
# the page whose connection is being served, as our proxy names it: viser's callbacks do not see headers
VIEW: ContextVar[str] = ContextVar("view", default="")

ProcessRequest = Callable[[ServerConnection, Request], Response | None]


class SceneServer:
    """A guarded viser server. `port` is where it listens, `secret` what the proxy has to bring."""

    def __init__(self) -> None:
        self.secret = secrets.token_urlsafe(32)
        _infra._message_producer = _produce  # every viser server of this process packs once for all pages
        with _guarded(self.secret), contextlib.redirect_stdout(io.StringIO()):
            self.viser = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.port = self.viser.get_port()
        # a page must not be able to open a tunnel to the outside
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            self.viser._websock_server.unregister_handler(message)

    def close(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


@contextlib.contextmanager
def _guarded(secret: str) -> Iterator[None]:
    """While it lasts, a WebSocket server that is made refuses every request without the secret."""
    serve = websockets.asyncio.server.serve

    def guarded_serve(
        handler: Any, host: str, port: int, *, process_request: ProcessRequest | None = None, **more: Any
    ) -> Any:
        def check(connection: ServerConnection, request: Request) -> Response | None:
            if not hmac.compare_digest(request.headers.get(SECRET_HEADER, "").encode(), secret.encode()):
                return Response(HTTPStatus.FORBIDDEN, "Forbidden", Headers({"Content-Length": "0"}), b"")
            welcome(connection.transport.get_extra_info("socket"), "proxy")
            return None if process_request is None else process_request(connection, request)

        async def named(connection: ServerConnection) -> None:
            VIEW.set("" if connection.request is None else connection.request.headers.get(VIEW_HEADER, ""))
            await handler(connection)

        door = Door(socket.create_server((host, port)), _STRANGERS)
        return serve(named, sock=door, backlog=AT_ONCE, process_request=check, **more)

    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # a traceback for each client that says nothing
    websockets.asyncio.server.serve = guarded_serve  # type: ignore[misc,assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
