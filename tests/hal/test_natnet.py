"""NatNet 3 and 4: frames taken apart, and a tracker that follows a body over the wire.

What Motive sends is written from the published description of its stream, not from our client.
"""

import contextlib
import math
import re
import socket
import struct
import threading
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from hal.clock_relation import ClockRelation
from hal.tracker import TrackerFrames, TrackerRequest, TrackerTimes
from hal.trackers.natnet import NatNetError, NatNetTracker, frame_of, version_in

Body = tuple[int, tuple[float, float, float], tuple[float, float, float, float], bool]  # id, position, xyzw, tracked


def _list(version: tuple[int, int], entries: Iterable[bytes]) -> bytes:
    entries = list(entries)
    content = b"".join(entries)
    size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
    return struct.pack("<i", len(entries)) + size + content


def _rigid(body: Body) -> bytes:
    number, position, xyzw, tracked = body
    return struct.pack("<i", number) + struct.pack("<7f", *position, *xyzw) + struct.pack("<fH", 3e-4, int(tracked))


def _channels(number: int) -> bytes:
    channels = [struct.pack("<i3f", 3, 0.1, 0.2, 0.3), struct.pack("<i1f", 1, 0.5)]
    return struct.pack("<ii", number, len(channels)) + b"".join(channels)


def _labeled(number: int) -> bytes:
    return struct.pack("<i3ffhf", number, 0.1, 0.2, 0.3, 0.014, 2, 1e-4)


def frame(version: tuple[int, int], number: int, stamp_s: float, bodies: list[Body]) -> bytes:
    """Return the message of a frame of data."""
    markers = [b"box\0" + struct.pack("<i6f", 2, *[0.25] * 6), b"all\0" + struct.pack("<i3f", 1, *[0.5] * 3)]
    parts = [
        struct.pack("<i", number),
        _list(version, markers),
        _list(version, [struct.pack("<3f", 1.0, 2.0, 3.0)] * 3),
        _list(version, map(_rigid, bodies)),
        _list(version, [struct.pack("<ii", 7, 2) + 2 * _rigid((1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), True))]),
    ]
    if version >= (4, 1):
        asset_body = struct.pack("<i7ffh", 2, *[8.0] * 3, 0.0, 0.0, 0.0, 1.0, 1e-4, 1)
        asset_marker = struct.pack("<i3ffhf", 5, *[8.0] * 3, 0.01, 2, 1e-4)
        parts.append(_list(version, [struct.pack("<ii", 3, 1) + asset_body + struct.pack("<i", 2) + 2 * asset_marker]))
    parts += [
        _list(version, map(_labeled, range(4))),
        _list(version, [_channels(1)]),
        _list(version, [_channels(2)]),
        struct.pack("<IId", 0, 0, stamp_s),
        struct.pack("<3Q", 10, 20, 30),
        struct.pack("<II", 1, 2) if version >= (4, 1) else b"",
        struct.pack("<hi", 0, 0),
    ]
    content = b"".join(parts)
    return struct.pack("<HH", 7, len(content)) + content


def server_info(version: tuple[int, int]) -> bytes:
    """Return the answer to a client that connects: the application's name and version, NatNet's, clock and port."""
    content = b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((*version, 0, 0))
    content += struct.pack("<QBHB4B", 10_000_000, 1, 1511, 0, 239, 255, 42, 99)
    return struct.pack("<HH", 1, len(content)) + content


class Motive:
    """A server that sends frames to who has connected and says regularly that he is still there."""

    def __init__(self, version: tuple[int, int], host: str = "127.0.0.1") -> None:
        self.version, self.frames = version, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self._socket.settimeout(0.1)
        self.address = self._socket.getsockname()
        self.client: tuple[str, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._over.is_set():
            try:
                message, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                continue
            (kind,) = struct.unpack_from("<H", message)
            if kind == 0:
                self._socket.sendto(server_info(self.version), sender)
                self.client = sender

    def wait_for_client(self, longest_s: float = 30.0) -> None:
        """Wait until a client has connected."""
        end_s = time.monotonic() + longest_s
        while self.client is None:
            assert time.monotonic() < end_s, "no client has connected"
            time.sleep(0.01)

    def send(self, stamp_s: float, bodies: list[Body]) -> None:
        """Send a frame to the client, if there is one."""
        self.frames += 1
        self.send_raw(frame(self.version, self.frames, stamp_s, bodies))

    def send_raw(self, message: bytes) -> None:
        """Send any bytes to the client."""
        if self.client is not None:
            self._socket.sendto(message, self.client)

    def start_again(self, version: tuple[int, int]) -> None:
        """Be another Motive at the same address, which knows no client."""
        self.version, self.client = version, None

    def send_to_all(self, group: str) -> None:
        """Send to a group, through the interface of the server's address."""
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.address[0]))
        self.client = (group, 1511)

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()
        self._socket.close()


VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
BODIES = [
    (3, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0), True),
    (4, (0.4, 0.5, 0.6), (0.5, 0.5, 0.5, 0.5), True),
    (5, (0.7, 0.8, 0.9), (0.0, 0.0, 0.0, 1.0), False),
]
# a frame of NatNet 4.1 with one body, byte by byte: nothing of it is made by a program of ours
BY_HAND = bytes.fromhex(
    "0700 8600 01000000"  # frame of data, 134 bytes, number 1
    "00000000 00000000 00000000 00000000"  # no marker sets, no markers without a name: each a count and a size
    "01000000 26000000"  # one body, 38 bytes
    "2a000000 0000803f 00000040 00004040"  # 42 at (1, 2, 3)
    "00000000 00000000 00000000 0000803f 0000003f 0100"  # not turned, error 0.5, tracked
    "00000000 00000000 00000000 00000000 00000000 00000000"  # skeletons, assets, labeled markers
    "00000000 00000000 00000000 00000000"  # force plates, devices
    "00000000 00000000 000000000000f83f"  # time code; 1.5 s
    "00000000 00000000 00000000 00000000 00000000 00000000"  # three times of a fine clock
    "00000000 00000000 0000 00000000"
)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_bodies_that_are_tracked_are_found_among_all_that_a_frame_has(version):
    stamp_s, bodies, *_ = frame_of(frame(version, 1, 12.5, BODIES), version)
    assert stamp_s == 12.5
    assert bodies.keys() == {3, 4}
    for number, position, xyzw, _ in BODIES[:2]:
        assert np.allclose(bodies[number], (*position, *xyzw), atol=1e-7)


def test_a_number_that_two_bodies_have_is_none():
    twice = [(4, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), tracked) for tracked in (True, False)]
    for bodies in ([*BODIES[:2], twice[0]], [*BODIES[:2], twice[1]], [*twice, BODIES[0]]):
        assert frame_of(frame((4, 1), 1, 12.5, bodies), (4, 1))[1].keys() == {3}


def test_a_frame_that_was_written_by_hand_is_read():
    assert frame_of(BY_HAND, (4, 1)) == (1.5, {42: (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)}, {42}, 1)


def test_a_server_tells_its_version():
    assert version_in(server_info((4, 1))) == (4, 1)
    with pytest.raises(NatNetError, match=r"2\.10"):
        version_in(server_info((2, 10)))


@pytest.mark.parametrize("version", [(3, 1), (4, 1)])
def test_what_is_no_frame_is_refused_and_nothing_else_happens(version):
    rng, whole = np.random.default_rng(5), frame(version, 1, 12.5, BODIES)
    refused = 0
    for length in range(8, len(whole) - 38):
        with pytest.raises(NatNetError):
            frame_of(whole[:length], version)
    for _ in range(3000):
        message = bytearray(whole)
        for place in rng.integers(8, len(whole), 4):
            message[place] = rng.integers(256)
        try:
            frame_of(bytes(message), version)
        except NatNetError:
            refused += 1
    assert refused > 100


@pytest.mark.parametrize("version", [(3, 1), (4, 1)])
def test_a_body_is_followed_in_the_world_and_in_the_robots_time(version):
    robot_clock = ClockRelation()
    offset_ns = 77_000_000_000  # of the robot's time to the host's

    def robot_ns():
        return time.monotonic_ns() - offset_ns

    half = math.sqrt(0.5)
    frames = TrackerFrames("y", (1.0, 2.0, 0.5), (half, 0.0, 0.0, half), (0.0, 0.1, 0.0))
    times = TrackerTimes("own", latency_ms=4.0, largest_age_ms=200.0)
    motive = Motive(version)
    tracker = NatNetTracker(TrackerRequest(*motive.address, frames, times, robot_clock, body=42))
    try:
        motive.wait_for_client()
        assert tracker.latest().record["seen"][0] == 0
        robot_clock.update(robot_ns(), time.monotonic_ns())
        end_s = time.monotonic() + 60.0
        sent, seen, errors_ms = 0, None, []
        while len(errors_ms) < 100:
            assert time.monotonic() < end_s
            exposed_ns, sent = robot_ns(), sent + 1
            time.sleep(4e-3)
            stamp_s = 5000.0 + 1.00005 * 1e-9 * exposed_ns  # a clock of its own, 50 ppm fast
            # Motive has y up: up by 0.3, 0.2 to the right, and what it calls -z is ahead
            motive.send(stamp_s, [(42, (0.2, 0.3, 0.0), (0.0, 0.0, 0.0, 1.0), True), BODIES[0]])
            time.sleep(1e-3)
            pose = tracker.latest()
            if pose.record["seen"][0] and pose.t_ns != seen:
                seen = pose.t_ns
                errors_ms.append(1e-6 * abs(pose.t_ns - exposed_ns))
        # (0.2, 0, 0.3) and 0.1 along the body's y, which is up, turned by 90 degrees about z, from (1, 2, 0.5)
        assert np.allclose(pose.position, (1.0, 2.2, 0.9), atol=1e-6)
        assert np.allclose(np.abs(pose.orientation_wxyz), 0.5, atol=1e-6)
        assert np.median(errors_ms) < 5.0
        motive.send_raw(b"\x07\x00\xff\xff")
        motive.send_raw(struct.pack("<HH", 7, 0) + bytes(300))
        motive.send(stamp_s + 1.0, [(42, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), False)])  # occluded
        motive.send(stamp_s + 1.0, [(42, (9.0, math.nan, 9.0), (0.0, 0.0, 0.0, 1.0), True)])
        while tracker.latest().record["seen"][0]:
            assert time.monotonic() < end_s
            time.sleep(1e-2)
        assert np.allclose(tracker.latest().position, (1.0, 2.2, 0.9), atol=1e-6)
    finally:
        tracker.close()
        motive.close()


@contextlib.contextmanager
def followed(motive, multicast=""):
    """Give what sends where body 42 is, and returns where the tracker sees it; None for nowhere."""
    robot_clock = ClockRelation()
    robot_clock.update(time.monotonic_ns(), time.monotonic_ns())
    times = TrackerTimes("own", largest_age_ms=300.0)
    request = TrackerRequest(*motive.address, TrackerFrames(), times, robot_clock, 42, multicast)

    def see(x: float, send=motive.send_raw) -> float | None:
        send(frame(motive.version, 1, time.monotonic(), [(42, (x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), True)]))
        time.sleep(5e-3)
        pose = tracker.latest()
        return round(float(pose.position[0]), 6) if pose.record["seen"][0] else None

    with contextlib.closing(NatNetTracker(request)) as tracker:
        yield see


def becomes(x, see, longest_s=30.0):
    end_s = time.monotonic() + longest_s
    while see(x) != x:
        assert time.monotonic() < end_s


def test_a_server_that_is_started_again_in_another_version_is_connected_to_again():
    with contextlib.closing(Motive((3, 1))) as motive, followed(motive) as see:
        motive.wait_for_client()
        becomes(0.25, see)
        motive.start_again((4, 1))
        motive.wait_for_client()
        becomes(0.5, see)


def test_frames_of_another_host_are_not_followed():
    with (
        contextlib.closing(Motive((4, 1))) as motive, followed(motive) as see,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):  # fmt: skip
        other.bind(("127.0.0.2", 0))
        motive.wait_for_client()
        becomes(0.25, see)
        for _ in range(100):
            assert see(0.5, lambda message: other.sendto(message, motive.client)) in (0.25, None)


def test_what_is_sent_to_all_is_received_at_the_interface_that_leads_to_the_server():
    with contextlib.closing(Motive((4, 1))) as motive, followed(motive, "239.255.42.99") as see:
        motive.wait_for_client()
        motive.send_to_all("239.255.42.99")
        becomes(0.25, see)


def becomes_found(tracker, complaint, about=True, longest_s=30.0):
    end_s = time.monotonic() + longest_s
    while not re.search(complaint, tracker.trouble(about)):
        assert time.monotonic() < end_s, tracker.trouble(about)
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("version", "sent", "complaint"),
    [
        ((2, 9), None, r"^speaks NatNet 2\.9, and 3\.0 to 4\.x are read"),
        ((5, 0), None, r"^speaks NatNet 5\.0, and"),
        ((4, 1), None, r"^speaks NatNet 4\.1 and sends no frames to this host \(unicast\): "),
        ((4, 1), lambda k: frame((3, 1), k, k, BODIES), "^sends messages of NatNet 4.1 that cannot be read: "),
        ((3, 1), lambda k: frame((4, 1), k, k, BODIES), "^sends messages of NatNet 3.1 that cannot be read: "),
        ((4, 1), lambda k: frame((4, 1), k, k, BODIES), r"^shows no body of streaming ID 42: .*found: 3, 4, 5$"),
        ((4, 1), lambda k: frame((4, 1), k, k, []), r"^shows no body of streaming ID 42: .*found: none$"),
        ((4, 1), lambda k: frame((4, 1), k, k, [(42, *BODIES[2][1:])]), "^shows body 42, and does not track it"),
        (
            (4, 1),
            lambda k: frame((4, 1), 7, 1.5, [(42, *BODIES[0][1:])]),
            r"^sends frame 7 at 1\.500 s again and again",
        ),
    ],
)
def test_what_stands_between_motive_and_the_body_is_found(version, sent, complaint):
    request = TrackerRequest("", 0, TrackerFrames(), TrackerTimes("own"), ClockRelation(), 42)
    with contextlib.closing(Motive(version)) as motive:
        request = replace(request, host=motive.address[0], port=motive.address[1])
        with contextlib.closing(NatNetTracker(request)) as tracker:
            motive.wait_for_client()
            end_s, k = time.monotonic() + 30.0, 0
            while not re.search(complaint, tracker.trouble(True)):
                assert time.monotonic() < end_s, tracker.trouble(True)
                k += 1
                if sent is not None:
                    motive.send_raw(sent(k))
                time.sleep(0.01)
            assert bool(tracker.trouble(False)) == (not complaint.startswith("^shows"))  # for a run about no object


def test_a_server_that_does_not_answer_and_a_process_that_has_ended_are_found():
    request = TrackerRequest("127.0.0.1", 9, TrackerFrames(), TrackerTimes("own"), ClockRelation(), 42)
    with contextlib.closing(NatNetTracker(request)) as tracker:
        becomes_found(tracker, "^does not answer: start Motive")
        tracker._process.kill()
        becomes_found(tracker, "^is not read any more: its process has ended with -9")


def test_without_the_bodys_number_it_is_refused():
    with pytest.raises(ValueError, match=r"\[tracker\.bodies\.OBJECT\] id"):
        NatNetTracker(TrackerRequest("127.0.0.1", 1, TrackerFrames(), TrackerTimes(), ClockRelation()))
