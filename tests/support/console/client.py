"""A client of the console: what several tests ask of it."""

import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from rtstack.teleoperation.stamp import Sender

PATIENCE_S = 120.0
TRIES = 100  # of a command on a machine that is too slow for the gate
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


def socket(served, path, client=None, **options):
    """Open a WebSocket as a page would, with a signed-in client's cookie."""
    if client is not None:
        options["additional_headers"] = {"cookie": served.cookie(client)}
    options.setdefault("origin", served.base)
    options.setdefault("subprotocols", ["viser-v1.1.1"] if path.startswith("/viser") else None)
    return connect(f"ws://127.0.0.1:{served.port}{path}", proxy=None, max_size=None, **options)


def has_ended(page):
    """Whether the console has closed a socket; what it says meanwhile is passed over."""
    try:
        page.recv(timeout=0.1)
    except TimeoutError:
        return False
    except ConnectionClosed:
        return True
    return False


def cookie_header(cookies):
    """Return cookies as a request's header."""
    return {"cookie": "; ".join(f"{name}={value}" for name, value in cookies.items())}


def say(client, headers, **message):
    """Send a message of a hand, on a picture that was just seen; again where this machine was too slow for the gate."""
    answer = None
    for _ in range(TRIES):
        sender = Sender()
        sender.saw(client.get("/api/teleoperation/hand", headers=headers).json())
        answer = client.post("/api/teleoperation/hand", json=sender.stamped(message), headers=headers)
        refusal = answer.json().get("refusal") or ""
        # a grip that was let go hides why a command of it was not applied: one that is in time is refused
        late = "not applied: it" in refusal or (message.get("clutch") and "the grip was let go" in refusal)
        if answer.status_code != 200 or not late:
            break
    return answer
