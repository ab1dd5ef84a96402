"""A client of the console: what several tests ask of it."""

import time

from websockets.sync.client import connect

PATIENCE_S = 60.0
SECRET = "a file's secret"


def arm(client, headers):
    """Take control and arm: what every order needs."""
    for verb in ("take", "arm"):
        assert client.post(f"/api/{verb}", json={}, headers=headers).status_code == 200


def wait_for(condition):
    """Wait until something is true, at most PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "did not happen"
        time.sleep(0.01)


def socket(served, path, **options):
    """Open a WebSocket as a page would."""
    options.setdefault("origin", served.base)
    options.setdefault("subprotocols", ["viser-v1.1.1"] if path.startswith("/viser") else None)
    return connect(f"ws://127.0.0.1:{served.port}{path}", proxy=None, max_size=None, **options)


def cookie_header(cookies):
    """Return cookies as a request's header."""
    return {"cookie": "; ".join(f"{name}={value}" for name, value in cookies.items())}
