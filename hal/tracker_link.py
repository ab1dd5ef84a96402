"""Object poses over UDP: one datagram is one record of hal.tracker.OBJECT_POSE, little-endian.

A tracker's poses, in its own frame and with times of its own clock, become the world's and the robot's here.
"""

import contextlib
import math
import socket
import time

import numpy as np

from hal.clock_relation import ClockRelation
from hal.compilation import bound, compiled
from hal.tracker import OBJECT_POSE, ObjectPose, TrackerFrames, TrackerRequest, TrackerTimes

DATAGRAM = OBJECT_POSE.newbyteorder("<")
_UNIT_TOLERANCE = 1e-2  # of a quaternion's norm: float32 and rounding, no more
_EARLY_NS, _LATEST_NS = 50_000_000, 2_000_000_000  # of an exposure before its datagram's arrival: what a network may do
_FAR_M = 100.0  # no laboratory is larger
_UP_Y = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # turns y up to z up, about x


@compiled
def _product(p, q, out):
    """Write the quaternion p q. wxyz."""
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


@compiled
def _turned(q, v, out):
    """Write v (3,) turned by the unit quaternion q: v + 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    cx, cy, cz = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    out[0] = v[0] + 2.0 * (w * cx + y * cz - z * cy)
    out[1] = v[1] + 2.0 * (w * cy + z * cx - x * cz)
    out[2] = v[2] + 2.0 * (w * cz + x * cy - y * cx)


_SIZE, _UNIT, _FAR, _TIME, _ORDER = range(1, 6)  # what is wrong with the last datagram; 0: nothing


@compiled
def _wrong_with(datagram):
    """Return what makes a datagram no pose, 0 for nothing."""
    d = datagram[0]
    squares = 0.0
    for i in range(4):
        squares += d.orientation_wxyz[i] ** 2
    if not abs(math.sqrt(squares) - 1.0) <= _UNIT_TOLERANCE:
        return _UNIT
    far = False
    for i in range(3):
        far |= not abs(d.position[i]) <= _FAR_M
    return _FAR if far else 0


@compiled
def _place(datagram, seen, world, world_p, thing, thing_p, plain, q, v):
    """Write the object's pose in the world into seen, its quaternion by the sign that is nearer to the last one. world,
    world_p: T_world_tracker; thing, thing_p: T_body_object; plain: both are none. q (4,), v (3,): to work with."""
    d, record = datagram[0], seen[0]
    if plain:
        for i in range(3):
            record.position[i] = d.position[i]
    else:
        norm = 0.0
        for i in range(4):
            norm += d.orientation_wxyz[i] ** 2
        norm = math.sqrt(norm)
        for i in range(4):
            d.orientation_wxyz[i] /= norm
        _turned(d.orientation_wxyz, thing_p, v)
        for i in range(3):
            d.position[i] += v[i]
        _turned(world, d.position, v)
        for i in range(3):
            record.position[i] = world_p[i] + v[i]
        _product(world, d.orientation_wxyz, q)
        _product(q, thing, d.orientation_wxyz)
    near = 0.0
    for i in range(4):
        near += d.orientation_wxyz[i] * record.orientation_wxyz[i]
    for i in range(4):
        record.orientation_wxyz[i] = d.orientation_wxyz[i] if near >= 0.0 else -d.orientation_wxyz[i]
    record.seen = d.seen


class TrackerLink:
    """An ObjectTracker that listens at a loopback or network address. `address` is where to send."""

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, frames: TrackerFrames | None = None,
        times: TrackerTimes | None = None, robot_clock: ClockRelation | None = None,
    ) -> None:  # fmt: skip
        """Listen; port 0 takes a free one. robot_clock: see hal.tracker.TrackerRequest; None: the datagrams have the
        robot's time, and none of them is too old. Raises OSError."""
        frames, self._times, self._robot = frames or TrackerFrames(), times or TrackerTimes(), robot_clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except BaseException:
            self._socket.close()
            raise
        self.address: tuple[str, int] = self._socket.getsockname()
        self.tracker_clock = ClockRelation()  # of the tracker's own clock (a) and the host's (b)
        # time of the newest pose, by the tracker's clock, and the steps of that clock before
        self._newest = -1 << 63, 0
        self._latency_ns = round(1e6 * self._times.latency_ms)
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        self._datagram = np.zeros(1, OBJECT_POSE)
        self._overlong = bytearray(DATAGRAM.itemsize + 1)
        self._wrong, self._size, self._last_ns = 0, 0, -1 << 63  # of the last datagram; its time
        world = np.array(frames.orientation_wxyz) / np.linalg.norm(frames.orientation_wxyz)
        if frames.up == "y":
            turned = np.zeros(4)
            _product(world, np.array(_UP_Y), turned)
            world = turned
        thing = np.array(frames.object_orientation_wxyz) / np.linalg.norm(frames.object_orientation_wxyz)
        self._wrong_with = bound(_wrong_with, self._datagram)
        self._place = bound(
            _place, self._datagram, self._seen.record, world, np.array(frames.position), thing,
            np.array(frames.object_position), frames == TrackerFrames(), np.zeros(4), np.zeros(3),
        )  # fmt: skip

    def latest(self) -> ObjectPose:
        """Return the newest pose that has arrived, without blocking. A datagram that is no pose is ignored."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self._size = self._socket.recv_into(self._overlong)
                self._wrong = _SIZE
                if self._size == DATAGRAM.itemsize:
                    self._datagram.view(DATAGRAM).view(np.uint8)[:] = self._overlong[:-1]
                    self._wrong = self._take()
        given = self._given.record
        given[:] = self._seen.record
        if self._is_old():
            given["seen"] = 0
        return self._given

    def trouble(self, _about: bool) -> str:
        """See hal.tracker.ClosableTracker: what was wrong with the last datagram."""
        d, wxyz = self._datagram[0], self._datagram["orientation_wxyz"][0]
        p = ", ".join(f"{x:.4g}" for x in d["position"])
        size, most = min(self._size, DATAGRAM.itemsize), DATAGRAM.itemsize
        return {
            _SIZE: f"sends datagrams of {'more' if self._size > most else size} bytes, expected {most}: "
            "a record of hal.tracker.OBJECT_POSE",
            _UNIT: f"sends a quaternion wxyz of length {np.linalg.norm(wxyz):.3g}, expected 1",
            _FAR: f"sends a place at {p} m, further than {_FAR_M:g} m: expected m, not mm",
            _TIME: f"sends poses with the time {d['t_ns']} ns, which is not now by its clock: correct [tracker] clock",
            _ORDER: f"sends poses whose time does not go on ({d['t_ns']} ns): its clock or its frames stand still",
        }.get(self._wrong, "")

    def _take(self) -> int:
        """Take a datagram. Returns what is wrong with it, 0 for nothing."""
        robot, t_ns = self._robot, int(self._datagram["t_ns"][0])
        now_ns, before_ns, self._last_ns = time.monotonic_ns(), self._last_ns, t_ns
        if wrong := self._wrong_with():
            return wrong
        if self._times.clock != "robot" and (robot is None or not robot.known):
            return 0  # no state of an arm has come yet, and no trial runs
        if self._times.clock in ("own", "host"):
            exposed_ns, steps = t_ns, 0
            if self._times.clock == "own":
                self.tracker_clock.update(t_ns, now_ns)
                if not self.tracker_clock.sure:
                    return 0 if t_ns > before_ns else _ORDER  # seen, but when?
                exposed_ns, steps = self.tracker_clock.b_of(t_ns), self.tracker_clock.resets
            if not now_ns - _LATEST_NS <= exposed_ns <= now_ns + _EARLY_NS:
                return _TIME  # of another time
            if t_ns <= self._newest[0] and steps == self._newest[1]:
                return _ORDER  # overtaken on the way
            self._newest, now_ns = (t_ns, steps), exposed_ns
        self._place()
        if robot is not None and self._times.clock != "robot":
            t_ns = robot.a_of(now_ns - self._latency_ns)
        self._seen.record["t_ns"] = t_ns
        return 0

    def _is_old(self) -> bool:
        """Whether the object was seen too long ago."""
        if self._robot is None or not self._robot.known or not math.isfinite(self._times.largest_age_ms):
            return False
        age_ns = self._robot.a_of(time.monotonic_ns()) - int(self._given.record["t_ns"][0])
        return age_ns > 1e6 * self._times.largest_age_ms

    def close(self) -> None:
        self._socket.close()


def open_link(request: TrackerRequest) -> TrackerLink:
    """Listen at a tracker's address for datagrams. Raises OSError."""
    return TrackerLink(request.host, request.port, request.frames, request.times, request.robot_clock)


class NoTracker:
    """The ObjectTracker of a cell that has none: the object is never seen."""

    def __init__(self, _request: TrackerRequest | None = None) -> None:
        self._pose = ObjectPose.empty()

    def latest(self) -> ObjectPose:
        return self._pose

    def close(self) -> None:
        """Do nothing: nothing was opened."""


open_none = NoTracker
