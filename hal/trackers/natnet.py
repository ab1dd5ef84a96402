"""OptiTrack's Motive over NatNet 3 and 4: a process that asks for the stream and passes one rigid body's poses on.

It sends to a hal.tracker_link.TrackerLink, in Motive's frame and with Motive's time stamps. A process of its own: what
comes from the network is taken apart outside the loop. Nothing maintained on PyPI reads NatNet 4.

The messages as in NaturalPoint's description of the bit stream (NatNet SDK 4.1, "direct depacketization"):
little-endian; a list has its length in front, and since 4.1 its size in bytes after it.
"""

import contextlib
import select
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hal.tracker import TrackerRequest
from hal.trackers.process import PoseSender, TrackerProcess, note, ready

CONNECT, KEEP_ALIVE, SERVER_INFO, FRAME_OF_DATA = 0, 10, b"\1\0", b"\7\0"
DATA_PORT = 1511
_MOST = 10_000  # of what a frame has of one kind
_RIGID_BODY = struct.Struct("<i3f4ffh")  # id, position, quaternion xyzw, mean error, parameters
_TRACKED = 1  # of its parameters
_LABELED_MARKER_BYTES = 26  # id, position, size, parameters, residual
_AGAIN_S = 1.0
_GRACE_S = 0.3  # to answer, to begin a stream
_STILL = 10  # frames of one number, or with one time stamp, one after the other
_SILENT_S = 3.0  # a server that has sent nothing for so long does not know this client, or not any more


class NatNetError(ValueError):
    """A message that is not what it says."""


class _Reader:
    """Takes a message apart from its front."""

    def __init__(self, data: bytes, version: tuple[int, int]) -> None:
        self._data, self._place = data, 0
        self.sized = version >= (4, 1)

    def take(self, layout: struct.Struct) -> tuple:
        self.skip(layout.size)
        return layout.unpack_from(self._data, self._place - layout.size)

    def skip(self, size: int) -> None:
        if size < 0 or self._place + size > len(self._data):
            raise NatNetError("it ends too early")
        self._place += size

    def whole(self) -> int:
        return self.take(_INT)[0]

    def count(self) -> int:
        number = self.whole()
        if not 0 <= number <= _MOST:
            raise NatNetError(f"a list of {number}")
        return number

    def text(self) -> None:
        end = self._data.find(b"\0", self._place)
        if end < 0:
            raise NatNetError("a name without an end")
        self._place = end + 1

    def skip_list(self, skip_entry: Callable[[], object]) -> None:
        """Skip a list by the size in front, where it stands there, else entry by entry."""
        number = self.count()
        if self.sized:
            self.skip(self.whole())
            return
        for _ in range(number):
            skip_entry()

    def skip_channels(self) -> None:
        self.skip(4)
        for _ in range(self.count()):
            self.skip(4 * self.count())


_INT, _DOUBLE = struct.Struct("<i"), struct.Struct("<d")


def version_in(message: bytes) -> tuple[int, int]:
    """Return NatNet's major and minor version of a server's information. Raises NatNetError."""
    name, versions = 256, 8  # the application's name; its version and NatNet's, four bytes each
    if len(message) < 4 + name + versions:
        raise NatNetError("answers with what is no server information of NatNet: is Motive at this address?")
    major, minor = message[4 + name + 4 : 4 + name + 6]
    if not 3 <= major <= 4:
        raise NatNetError(f"speaks NatNet {major}.{minor}, and 3.0 to 4.x are read: use a Motive that speaks those")
    return major, minor


class Frame(NamedTuple):
    """A frame of data: its time stamp, s since Motive has begun; of the tracked bodies, by their numbers, position, m,
    and quaternion xyzw, in Motive's frame; the numbers of all bodies; its own. Two bodies of a number are not tracked.
    """

    stamp_s: float
    bodies: dict[int, tuple[float, ...]]
    numbers: set[int]
    number: int


def frame_of(message: bytes, version: tuple[int, int]) -> Frame:
    """Take a frame of data apart. Raises NatNetError."""
    reader = _Reader(message, version)
    reader.skip(4)  # message, size
    frame_number = reader.whole()
    reader.skip_list(lambda: (reader.text(), reader.skip(12 * reader.count())))  # marker sets
    reader.skip_list(lambda: reader.skip(12))  # markers without a name
    bodies: dict[int, tuple[float, ...]] = {}
    numbers: set[int] = set()
    count = reader.count()
    if reader.sized:
        reader.whole()  # its bytes
    for _ in range(count):
        number, *pose, _error, parameters = reader.take(_RIGID_BODY)
        if number in numbers:
            bodies.pop(number, None)
        elif parameters & _TRACKED:
            bodies[number] = tuple(pose)
        numbers.add(number)
    reader.skip_list(lambda: (reader.skip(4), reader.skip(_RIGID_BODY.size * reader.count())))  # skeletons
    if reader.sized:
        reader.skip_list(lambda: None)  # assets, new in 4.1
    reader.skip_list(lambda: reader.skip(_LABELED_MARKER_BYTES))
    for _ in range(2):  # force plates, devices
        reader.skip_list(reader.skip_channels)
    reader.skip(8)  # time code
    (stamp,) = reader.take(_DOUBLE)
    return Frame(stamp, bodies, numbers, frame_number)


class _Client:
    """Asks a server for its stream, again and again, and passes on what it sends."""

    def __init__(self, server: tuple[str, int], body: int, listener: tuple[str, int], multicast: str) -> None:
        self._server, self._body, self._sender = server, body, PoseSender(listener)
        self._version: tuple[int, int] | None = None
        self._heard_s = 0.0
        self._began_s, self._framed_s = time.monotonic(), 0.0  # the last frame that could be read
        self._wrong = ""  # with the last message of the server
        self._frame, self._still = Frame(-1.0, {}, set(), -1), 0
        self._multicast, self._noted = multicast, ""
        self._asking = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets = [self._asking]
        if multicast:
            group = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            group.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            group.bind((multicast, DATA_PORT))
            # at the interface through which the server is reached: another one may be the default
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
                way.connect(server)
                member = socket.inet_aton(multicast) + socket.inet_aton(way.getsockname()[0])
            group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            self._sockets.append(group)

    def run(self) -> None:
        asked_s = -_AGAIN_S
        while True:
            if time.monotonic() - asked_s >= _AGAIN_S:
                asked_s = time.monotonic()
                self._ask()
            for filled in select.select(self._sockets, [], [], _GRACE_S / 3)[0]:
                with contextlib.suppress(OSError):
                    message, (host, _) = filled.recvfrom(65536)
                    if host == self._server[0]:  # a second Motive sends to the same group
                        self._heard_s = time.monotonic()
                        self._take(message)
            if (found := self._finding()) != self._noted:
                self._noted = found
                note(found, body=found.startswith("shows"))

    def _finding(self) -> str:
        """Return what is wrong and what to do, "" for nothing; "shows" begins what is about the body alone."""
        now_s, frame = time.monotonic(), self._frame
        if self._wrong or now_s - self._began_s < _GRACE_S:
            return self._wrong
        if self._version is None:
            return "does not answer: start Motive with streaming on, and look at address, network and firewall (UDP)"
        if now_s - self._framed_s > 2.0 * _GRACE_S:
            where = f"the group {self._multicast}" if self._multicast else "this host (unicast)"
            speaks = ".".join(map(str, self._version))
            look = "look at Motive's streaming, at multicast under [tracker], and at the firewall (UDP)"
            return f"speaks NatNet {speaks} and sends no frames to {where}: {look}"
        if self._still >= _STILL:
            return f"sends frame {frame.number} at {frame.stamp_s:.3f} s again and again: Motive is paused, continue it"
        if self._body not in frame.bodies:
            there = ", ".join(map(str, sorted(frame.numbers)[:20])) or "none"
            if self._body in frame.numbers:
                return f"shows body {self._body}, and does not track it: uncover its markers; bodies found: {there}"
            return f"shows no body of streaming ID {self._body}: correct [tracker.bodies]; bodies found: {there}"
        return ""

    def _ask(self) -> None:
        """Connect; once connected, say regularly that this client is there: a server ends a silent one. One that was
        started again does not know it, and may be of another version."""
        if time.monotonic() - self._heard_s > _SILENT_S:
            self._version = None
        message, text = (CONNECT, b"Ping\0") if self._version is None else (KEEP_ALIVE, b"\0")
        with contextlib.suppress(OSError):
            self._asking.sendto(struct.pack("<HH", message, len(text)) + text, self._server)

    def _take(self, message: bytes) -> None:
        """Take a message of the server, and keep what is wrong with it."""
        kind, self._wrong = message[:2], ""
        try:
            if kind == SERVER_INFO:
                self._version = version_in(message)
            if kind != FRAME_OF_DATA or self._version is None:
                return
            before, frame = self._frame, frame_of(message, self._version)
        except NatNetError as error:
            speaks = ".".join(map(str, self._version or ()))
            self._wrong = f"sends messages of NatNet {speaks} that cannot be read: {error}" if speaks else str(error)
            return
        self._frame, self._framed_s, stamp_s = frame, time.monotonic(), frame.stamp_s
        self._still = self._still + 1 if frame.number == before.number or stamp_s == before.stamp_s else 0
        pose = frame.bodies.get(self._body)
        if pose is not None and np.isfinite(stamp_s) and abs(stamp_s) < 1e9:
            self._sender.send(round(1e9 * stamp_s), pose[:3], (pose[6], *pose[3:6]))


class NatNetTracker(TrackerProcess):
    """A hal.tracker.ClosableTracker: one rigid body of Motive."""

    def __init__(self, request: TrackerRequest) -> None:
        """Start the process. Raises OSError, also where the host's name is not known; ValueError for a request without
        the body's number."""
        arguments = (socket.gethostbyname(request.host), str(request.port), str(request.body), request.multicast)
        super().__init__(request, "hal.trackers.natnet", *arguments)


def main() -> None:
    """Pass poses on until its parent ends. Arguments: server, port, body, multicast group or "", host, port."""
    ip, port, body, multicast, host, to_port = sys.argv[1:]
    client = _Client((ip, int(port)), int(body), (host, int(to_port)), multicast)
    ready()
    client.run()


if __name__ == "__main__":
    main()
