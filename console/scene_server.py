"""A viser server that only our proxy can reach: loopback, a free port, and a secret header on every request.

viser 1.1.1 has no sign-in and no Origin check of its own, so its port is guarded where its WebSocket server is made.
The version is pinned, and the refusal is tested.
"""

import contextlib
import hmac
import io
import secrets
from collections.abc import Awaitable, Callable, Iterator
from contextvars import ContextVar
from http import HTTPStatus
from typing import Any

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from console.scene_stream import share_packing

SECRET_HEADER = "x-rtstack-scene"
VIEW_HEADER = "x-rtstack-view"
# the page whose connection is being served, as our proxy names it: viser's callbacks do not see headers
VIEW: ContextVar[str] = ContextVar("view", default="")

ProcessRequest = Callable[[ServerConnection, Request], Response | None]


class SceneServer:
    """A guarded viser server. `port` is where it listens, `secret` what the proxy has to bring."""

    def __init__(self) -> None:
        self.secret = secrets.token_urlsafe(32)
        share_packing()
        with _guarded(self.secret), contextlib.redirect_stdout(io.StringIO()):
            self.viser = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.port = self.viser.get_port()
        # a page must not be able to open a tunnel to the outside
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            self.viser._websock_server.unregister_handler(message)

    @property
    def watched(self) -> bool:
        """Whether a page shows this scene now."""
        return bool(self.viser.get_clients())

    def close(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


@contextlib.contextmanager
def _guarded(secret: str) -> Iterator[None]:
    """While it lasts, a WebSocket server that is made refuses every request without the secret."""
    serve = websockets.asyncio.server.serve

    def guarded_serve(
        handler: Callable[[ServerConnection], Awaitable[None]],
        *arguments: Any,
        process_request: ProcessRequest | None = None,
        **options: Any,
    ) -> Any:
        def check(connection: ServerConnection, request: Request) -> Response | None:
            brought = request.headers.get(SECRET_HEADER, "")
            if not hmac.compare_digest(brought.encode(), secret.encode()):
                return Response(HTTPStatus.FORBIDDEN, "Forbidden", Headers({"Content-Length": "0"}), b"")
            return None if process_request is None else process_request(connection, request)

        async def named(connection: ServerConnection) -> None:
            VIEW.set("" if connection.request is None else connection.request.headers.get(VIEW_HEADER, ""))
            await handler(connection)

        return serve(named, *arguments, process_request=check, **options)

    websockets.asyncio.server.serve = guarded_serve  # type: ignore[misc,assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
