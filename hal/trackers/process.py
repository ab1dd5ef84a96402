"""A tracker's own process: it speaks with what sees the object, and passes poses on as our datagrams."""

import contextlib
import errno
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence

import numpy as np

from hal.base.arrays import Array
from hal.base.realtime import end_with_parent
from hal.tracker import TrackerRequest
from hal.tracker_link import DATAGRAM, TrackerLink

_END_S = 1.0  # to end by itself
# until it has loaded what it needs, OpenCV above all: a trial that began before would be one that nothing sees
_READY_S = 15.0
_NOTE_BYTES = 400


def ready() -> None:
    """In the process: say that it looks from now on, and end with who has started it."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal: who has started it ends it
    print(flush=True)


def note(text: str, body: bool = False) -> None:
    """In the process: keep what stands between the tracker and the object, "" for nothing
    (hal.tracker.ClosableTracker), in the file that is its standard input: nothing waits for a reader.

    body: it counts for a run that is about the object alone.
    """
    written = (" " if body else "") + text
    os.pwrite(0, written.encode()[:_NOTE_BYTES].ljust(_NOTE_BYTES, b"\0"), 0)


class PoseSender:
    """In the process: sends poses to a hal.tracker_link.TrackerLink. A link that is not there is no error."""

    def __init__(self, link: tuple[str, int]) -> None:
        self._link, self._datagram = link, np.zeros(1, DATAGRAM)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, t_ns: int, position: Sequence[float] | Array, wxyz: Sequence[float] | Array) -> None:
        """Send a pose in the tracker's frame, (3,) m and (4,), with the tracker's time."""
        datagram = self._datagram
        datagram["t_ns"], datagram["seen"] = t_ns, 1
        datagram["position"], datagram["orientation_wxyz"] = position, wxyz
        with contextlib.suppress(OSError):
            self._socket.sendto(datagram.tobytes(), self._link)


class TrackerProcess:
    """A link, and the module of ours that feeds it: `python -m MODULE ARGUMENTS...

    HOST PORT` of the link, which calls `ready`. Raises OSError, ValueError for a request without the number of what is
    followed.
    """

    def __init__(self, request: TrackerRequest, module: str, *arguments: str) -> None:
        if request.body is None:
            raise ValueError("the number of the object's rigid body or tag is missing: [tracker.bodies.OBJECT] id")
        self._link = TrackerLink("127.0.0.1", 0, request.frames, request.times, request.robot_clock)
        self.latest = self._link.latest
        command = [sys.executable, "-m", module, *arguments, *map(str, self._link.address)]
        self._note = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
        self._process = subprocess.Popen(command, stdin=self._note, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        with self._process.stdout as said:
            if not (select.select([said], [], [], _READY_S)[0] and said.readline()):
                self.close()
                raise OSError(errno.ECHILD, f"{module} did not begin")

    def trouble(self, about: bool) -> str:
        if self._process.poll() is not None:
            return f"is not read any more: its process has ended with {self._process.returncode}; begin again"
        text = os.pread(self._note.fileno(), _NOTE_BYTES, 0).rstrip(b"\0").decode(errors="replace")
        return (text.strip() if about or not text.startswith(" ") else "") or self._link.trouble(about)

    def close(self) -> None:
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self._process.kill()
        self._process.wait()
        self._note.close()
        self._link.close()
