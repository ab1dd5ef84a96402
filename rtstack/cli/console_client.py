"""A program's connection to a console: requests, and a WebSocket on which it waits for each answer.

One thread reads and writes it: over HTTPS two lose one connection of twenty as it opens (python/cpython#143756).
"""

import asyncio
import ssl
import threading
import time
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from rtstack.access.authority import Authority
from rtstack.trials.errors import TrialError

T = TypeVar("T")
_TIMEOUT_S = 30.0  # to open a cell of a simulated robot takes seconds
_BUSY, _AGAIN_S = 503, 0.02


def authorization(token: str) -> dict[str, str]:
    """Return the header that signs a program in. Raises TrialError."""
    if not token.isascii() or not token.isprintable() or not token:
        raise TrialError("--token is no token: make one with rtstack token create --scope operate")
    return {"authorization": f"Bearer {token}"}


class Operator:
    """A program that is signed in to a console. Raises TrialError with the console's reason."""

    def __init__(self, address: str, token: str) -> None:
        self._address, self._headers = address, authorization(token)
        self._tls = Authority.trusting()
        self._http = httpx.Client(
            base_url=address, headers=self._headers, timeout=_TIMEOUT_S, trust_env=False, verify=self._tls
        )
        self.close = self._http.close

    def post(self, path: str, **body: object) -> dict[str, Any]:
        """Ask for something; return the answer."""
        try:
            answer = self._http.post(f"/api/{path}", json=body)
            while answer.status_code == _BUSY and path == "beat":  # the robot process answers late: nothing is lost yet
                time.sleep(_AGAIN_S)
                answer = self._http.post(f"/api/{path}", json=body)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise TrialError(f"{self._address}: no console answers ({error}); start one with rtstack up") from None
        if answer.is_error:
            raise TrialError(f"{path}: {_reason(answer)}")
        return answer.json()

    def hand(self) -> AbstractContextManager["Stream"]:
        """Give the stream of hand messages; closing it lets go."""
        return open_stream(self._address, "/api/teleoperation/hand", self._headers, self._tls)


def _reason(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["error"])
    except (ValueError, KeyError, TypeError):
        return f"the console answers {answer.status_code}"


class Stream:
    """Messages to a console, and its answers."""

    def __init__(self, connection: ClientConnection, loop: asyncio.AbstractEventLoop) -> None:
        self._connection, self._loop = connection, loop

    def send(self, message: str) -> None:
        """Send a message."""
        _wait(self._connection.send(message), self._loop)

    def recv(self, timeout_s: float) -> str | bytes:
        """Return the next message. Raises TimeoutError where none comes in time."""
        return _wait(asyncio.wait_for(self._connection.recv(), timeout_s), self._loop)


@contextmanager
def open_stream(console: str, path: str, headers: Mapping[str, str], tls: ssl.SSLContext) -> Iterator[Stream]:
    """Give a stream to a path of a console; closing it lets go. tls: who is trusted. Raises TrialError."""
    address = console.replace("http", "ws", 1).rstrip("/") + path
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="stream", daemon=True)
    thread.start()
    try:
        connection = _wait(_connect(address, headers, tls if address.startswith("wss") else None), loop)
        try:
            yield Stream(connection, loop)
        finally:
            _wait(connection.close(), loop)
    except (WebSocketException, OSError) as error:
        raise TrialError(f"the connection to {console} has broken: {error}") from None
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _connect(address: str, headers: Mapping[str, str], tls: ssl.SSLContext | None) -> ClientConnection:
    return await connect(address, additional_headers=headers, proxy=None, ssl=tls)


def _wait(work: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop) -> T:
    return asyncio.run_coroutine_threadsafe(work, loop).result()
