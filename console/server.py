"""How the application is served: the same for the stack and for the tests that attack it."""

import asyncio
import asyncio.constants
import ssl

import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from console.connections import AT_ONCE

_MAX_MESSAGE_BYTES = 1 << 20  # of a WebSocket
PATIENCE_S = 10.0  # for a request to arrive whole: a body is small, and this machine's


class PatientProtocol(H11Protocol):
    """HTTP with an end to a client that sends its request byte by byte, or none: uvicorn itself would wait for ever."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request. The guard finds the connection by the stream in the scope's state."""
        super().connection_made(transport)
        self.app_state = {**self.app_state, "stream": transport.get_extra_info("socket")}
        self._late = self.loop.call_later(PATIENCE_S, transport.abort)

    def data_received(self, data: bytes) -> None:
        """Take a part of a request; it does not begin the time anew."""
        super().data_received(data)
        if self.conn.their_state not in (h11.IDLE, h11.SEND_BODY) or self.transport.get_protocol() is not self:
            self._arrived()
        elif self._late is None:
            self._late = self.loop.call_later(PATIENCE_S, self.transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing any more."""
        self._arrived()
        super().connection_lost(exc)

    def _arrived(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def server_settings(app: FastAPI, tls: ssl.SSLContext | None = None) -> uvicorn.Config:
    """Return uvicorn's settings; with tls, it speaks HTTPS alone. No proxy is believed."""
    if tls is not None:  # uvicorn hands neither on
        asyncio.constants.SSL_HANDSHAKE_TIMEOUT = asyncio.constants.SSL_SHUTDOWN_TIMEOUT = PATIENCE_S  # type: ignore[misc]
    return uvicorn.Config(
        app,
        lifespan="on",
        backlog=AT_ONCE,
        log_level="error",  # a warning is a line for each request that is none
        access_log=False,
        http=PatientProtocol,
        ws="websockets-sansio",
        ws_per_message_deflate=False,  # for each page anew, of what is small or packed already: dear, and worth nothing
        ws_max_size=_MAX_MESSAGE_BYTES,
        ws_ping_interval=5.0,  # a connection whose other end is gone is closed within 25 s, with uvicorn's time limit
        server_header=False,
        ssl_context_factory=None if tls is None else lambda *_: tls,
        proxy_headers=False,
        timeout_graceful_shutdown=2,
    )
