"""How the application is served: the same for the stack and for the tests that attack it."""

import uvicorn
from fastapi import FastAPI

_MAX_MESSAGE_BYTES = 1 << 20  # of a WebSocket


def server_settings(app: FastAPI) -> uvicorn.Config:
    """Return uvicorn's settings. No proxy is believed, and nothing says which server this is."""
    return uvicorn.Config(
        app,
        lifespan="on",
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=_MAX_MESSAGE_BYTES,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=2,
    )
