"""The robot process's socket: a side thread that reads requests and writes answers, and never touches an arm.

It calls the control authority regularly, so that a lease ends without a request. Its threads have raised priority.
"""

import contextlib
import os
import socket
import socketserver
import threading
from concurrent.futures import TimeoutError as RecoveryTimeout
from pathlib import Path
from typing import Any

from hal.base.realtime import beside_realtime
from hal.errors import HardwareError
from rtstack.live.client import peer_uid
from rtstack.live.job_manager import JobManager
from rtstack.live.notify import Pulse
from rtstack.live.protocol import (
    MAX_LINE_BYTES,
    Answer,
    ControlRequest,
    NoteRequest,
    ProtocolError,
    Request,
    StatusRequest,
    TakeRequest,
    decode_request,
    encode,
)
from rtstack.safety.arming import Refused

# of both arms at once: a real one takes 0.7 to more than 12 s (GitHub, franka_ros issues 317 and 308)
_RECOVERY_TIMEOUT_S = 30.0
_MOST_CONNECTIONS = 64  # a thread each; a console has four
_WATCH_S = 0.05  # period of the calls to the control authority


class Service:
    """Serves a job manager at a Unix-domain socket that only this user can open."""

    def __init__(self, job_manager: JobManager, path: Path, pulse: Pulse | None = None) -> None:
        self._path = path
        mask = os.umask(0o177)  # the socket is ours alone from the first moment on
        try:
            self._server = _Server(str(path), _Handler)
        finally:
            os.umask(mask)
        self._server.job_manager, self._server.pulse = job_manager, pulse
        threading.Thread(target=self._serve, daemon=True, name="service").start()

    def _serve(self) -> None:
        beside_realtime()
        self._server.serve_forever(_WATCH_S)

    def close(self) -> None:
        """Stop serving and remove the socket."""
        self._server.shutdown()
        self._server.server_close()
        self._path.unlink(missing_ok=True)


class _Server(socketserver.ThreadingUnixStreamServer):
    daemon_threads = True
    request_queue_size = 1024  # a full queue refuses at once
    job_manager: JobManager
    pulse: Pulse | None

    def __init__(self, *arguments: Any) -> None:
        self.waiting: dict[socket.socket, None] = {}  # connections without an open request, the longest first
        super().__init__(*arguments)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Called by serve_forever: only programs of this user, and of root, are served, and so many at a time."""
        if peer_uid(request) not in (0, os.geteuid()):
            return False
        self.waiting[request] = None
        if len(self.waiting) > _MOST_CONNECTIONS:
            longest = next(iter(self.waiting))
            del self.waiting[longest]
            with contextlib.suppress(OSError):
                longest.shutdown(socket.SHUT_RDWR)  # its thread ends
        return True

    def service_actions(self) -> None:
        """Called by serve_forever about once in _WATCH_S, whatever is asked."""
        self.job_manager.authority.watch()
        if self.pulse is not None:
            self.pulse.look()


class _Handler(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        beside_realtime()
        assert isinstance(self.server, _Server)
        with contextlib.suppress(ConnectionError):
            while line := self.rfile.readline(MAX_LINE_BYTES):
                self.server.waiting.pop(self.request, None)
                self.wfile.write(encode(answer(self.server.job_manager, line)))
                self.server.waiting[self.request] = None
        self.server.waiting.pop(self.request, None)


def answer(job_manager: JobManager, line: bytes) -> Answer:
    """Return the answer to the request on a line. Never raises: what is wrong becomes the answer's error."""
    try:
        _act(job_manager, decode_request(line))
        return Answer(status=job_manager.status())
    except (ProtocolError, Refused, HardwareError) as error:
        return Answer(error=str(error))
    except RecoveryTimeout:
        return Answer(error=f"no answer from the robot within {_RECOVERY_TIMEOUT_S:g} s")


def _act(job_manager: JobManager, request: Request) -> None:
    match request:
        case StatusRequest():
            pass  # it is what every answer carries
        case TakeRequest():
            job_manager.authority.take(request.operator, request.over_from)
        case NoteRequest():
            job_manager.authority.note(request.operator, request.text, request.failed)
        case ControlRequest(verb="recover"):
            job_manager.recover(request.operator).result(_RECOVERY_TIMEOUT_S)
        case ControlRequest():
            getattr(job_manager.authority, request.verb)(request.operator)
        case _:
            job_manager.order(request)
