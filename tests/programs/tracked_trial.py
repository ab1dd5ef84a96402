"""A trial on served arms whose object a tracker watches, through a bad network: where and when the log has the object.

`python -m tests.programs.tracked_trial [--tracker natnet|udp|apriltag|none] [--version 4.1] [--loss 0.05]
[--jitter-ms 20] [--ppm 50] [--step-s 3600]`

udp: the same poses as datagrams of our own, with the same clock. apriltag: of each pose that a camera of 20 Hz takes, a
picture is drawn and sent, with the host's time, and the tag is found in it; the place is compared with the true one at
the logged time, and the time by the shift of the whole log that makes the places fit best. Of the same trial MuJoCo
then draws what the camera would have seen, the arms in front of the tag where they were, and the tag is found in that.
none: the trial has to say that the object was not observed.

What sees the object stamps it when the kernel got its pose: by this host's clock, which goes on where the simulated
robot's stands still because its host was busy. How often that was is printed: a robot's own never does.

natnet: the poses of the simulated tracker are turned into what Motive sends (its y is up, it stands elsewhere, follows
a body beside the object, and has a clock of its own that steps once, while the object is lifted), delayed, dropped and
overtaken; `rtstack trial` reads them by `kind = "natnet"`. Each pose in the log is compared with the simulated
tracker's own pose and time. In real time. Exit status 1 where the trial fails or the log is off by more than 2 mm or
5 ms (95 of 100 poses).
"""

import argparse
import contextlib
import dataclasses
import heapq
import json
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np

from hal.apriltag import detector
from hal.configuration import toml_text
from hal.tracker_link import DATAGRAM
from rtstack.cells import default_cell_file
from rtstack.log.reader import Log, read_log
from rtstack.model.rotation import quaternion_from_rotation, rotation_from_quaternion
from rtstack.samples import SIDES
from tests.support.fci.server import serve
from tests.support.trackers.motive import Motive
from tests.support.trackers.rendered import RenderedCell
from tests.support.trackers.tags import CAMERA, Sender, looking_at, picture

COMMAND = Path(sys.executable).with_name("rtstack")
BODY, TOP_M = 42, 0.1  # its number, and half of the rice box's height
MOTIVE_P, MOTIVE_Q = np.array([0.6, -0.2, 0.1]), np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])  # in the world
PIVOT = np.array([0.02, -0.03, 0.09])  # of the object in the body
UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from Motive's axes to those with z up
EYE = looking_at((-0.35, 0.05, 1.25), (0.0, 0.0, 0.5))
MOST_MM, MOST_MS = 2.0, 5.0
LIFTED_M = 0.02  # from there on the object is on its way up
PERIOD_NS = 50_000_000  # of the camera
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h: each datagram carries when the kernel got it, a timespec


class Watcher(Protocol):
    """What sees the object in the place of the simulated tracker."""

    table: str  # of the cell's file

    @property
    def watched(self) -> bool:
        """Whether a client is there."""
        ...

    def seen(self, record: np.void, exposed_ns: int, stamp_s: float) -> Any:
        """Return what is to be sent of a pose; None for nothing. exposed_ns: by time.monotonic_ns; stamp_s: by a clock
        of the tracker's own."""
        ...

    def send(self, what: Any) -> None:
        """Send it."""
        ...

    def close(self) -> None:
        """End."""
        ...


class MotiveWatcher:
    """Motive: its y is up, it stands elsewhere and follows a body beside the object."""

    def __init__(self, version: str) -> None:
        major, minor = map(int, version.split("."))
        self._motive = Motive((major, minor))
        self.table = f"""kind = "natnet"
address = "{{}}:{{}}"
up = "y"
position = {MOTIVE_P.tolist()}
orientation_wxyz = {MOTIVE_Q.tolist()}
largest_age_ms = 100.0
[tracker.bodies.rice_box]
id = {BODY}
position = {PIVOT.tolist()}
""".format(*self._motive.address)

    @property
    def watched(self) -> bool:
        return self._motive.client is not None

    def seen(self, record: np.void, exposed_ns: int, stamp_s: float) -> Any:
        return stamp_s, seen_by_motive(record)

    def send(self, what: Any) -> None:
        stamp_s, (position, xyzw) = what
        self._motive.send(stamp_s, [(1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), True), (BODY, position, xyzw, True)])

    def close(self) -> None:
        self._motive.close()


class UdpWatcher:
    """A tracker that sends our own datagrams, of its own frame and clock."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self._client = free.getsockname()
        self.watched, self._datagram = True, np.zeros(1, DATAGRAM)
        self.table = f"""kind = "udp"
address = "{{}}:{{}}"
clock = "own"
position = {MOTIVE_P.tolist()}
orientation_wxyz = {MOTIVE_Q.tolist()}
""".format(*self._client)

    def seen(self, record: np.void, exposed_ns: int, stamp_s: float) -> Any:
        world, q = rotation_from_quaternion(MOTIVE_Q), np.zeros(4)
        R = world.T @ rotation_from_quaternion(record["orientation_wxyz"])
        quaternion_from_rotation(np.ascontiguousarray(R), q)
        self._datagram["t_ns"], self._datagram["seen"] = round(1e9 * stamp_s), 1
        self._datagram["position"], self._datagram["orientation_wxyz"] = world.T @ (record["position"] - MOTIVE_P), q
        return self._datagram.tobytes()

    def send(self, what: Any) -> None:
        self._socket.sendto(what, self._client)

    def close(self) -> None:
        self._socket.close()


class TagWatcher:
    """A camera of 20 Hz over the table, and a tag on the object."""

    def __init__(self) -> None:
        self._sender, self._eye = Sender(), EYE
        self._next_ns = 0
        R, q, p = self._eye[:3, :3], np.zeros(4), self._eye[:3, 3]
        quaternion_from_rotation(np.ascontiguousarray(R), q)
        camera = dataclasses.asdict(dataclasses.replace(CAMERA, source=self._sender.source))
        self.table = f"""kind = "apriltag"
position = {p.tolist()}
orientation_wxyz = {q.tolist()}
largest_age_ms = 200.0
[tracker.bodies.rice_box]
id = {BODY}
position = [0.0, 0.0, {-TOP_M}]
""" + toml_text({"tracker": {"camera": camera}}).partition("[tracker]\n")[2]

    @property
    def watched(self) -> bool:
        return self._sender.connected

    def seen(self, record: np.void, exposed_ns: int, stamp_s: float) -> Any:
        if exposed_ns < self._next_ns or not self.watched:
            return None
        self._next_ns = exposed_ns + PERIOD_NS
        T = np.eye(4)
        T[:3, :3] = rotation_from_quaternion(record["orientation_wxyz"])
        T[:3, 3] = record["position"] + T[:3, 2] * TOP_M
        return exposed_ns, picture(CAMERA, {BODY: np.linalg.inv(self._eye) @ T})

    def send(self, what: Any) -> None:
        self._sender.send(*what)

    def close(self) -> None:
        self._sender.close()


class NoWatcher:
    """Nothing sees the object."""

    table, watched = 'kind = "none"\n', False

    def seen(self, record: np.void, exposed_ns: int, stamp_s: float) -> Any:
        return None

    def send(self, what: Any) -> None:
        """Nothing is sent."""

    def close(self) -> None:
        """Nothing was opened."""


class Relay:
    """What stands between the simulated tracker and the client: another tracker, and a bad network."""

    def __init__(self, watcher: Watcher, options: argparse.Namespace) -> None:
        self.truth: list[tuple[int, np.ndarray, np.ndarray]] = []
        self._watcher, self._options, self._rng = watcher, options, np.random.default_rng(options.seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(1e-3)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self.address = "{}:{}".format(*self._socket.getsockname())
        self._over, self._began_ns = threading.Event(), time.monotonic_ns()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        waiting: list[tuple[float, int, Any]] = []
        stepped = False  # the tracker's clock, in the middle of what is judged
        while not self._over.is_set():
            try:
                data, ancillary, _, _ = self._socket.recvmsg(256, 64)
                (record,) = np.frombuffer(data, DATAGRAM)
            except TimeoutError:
                record, ancillary = None, []
            if record is not None:
                self.truth.append((int(record["t_ns"]), record["position"].copy(), record["orientation_wxyz"].copy()))
                stepped |= bool(record["position"][2] - self.truth[0][1][2] > LIFTED_M)
                seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
                exposed_ns = 10**9 * seconds + nanoseconds - time.time_ns() + time.monotonic_ns()
                stamp_s = 1000.0 + (1.0 + 1e-6 * self._options.ppm) * 1e-9 * (exposed_ns - self._began_ns)
                stamp_s += self._options.step_s * stepped
                what = self._watcher.seen(record, exposed_ns, stamp_s)
                if what is not None and self._rng.random() >= self._options.loss:
                    due_s = 1e-9 * exposed_ns + 1e-3 * self._options.jitter_ms * self._rng.random()
                    heapq.heappush(waiting, (due_s, len(self.truth), what))
            while waiting and waiting[0][0] <= time.monotonic():
                self._watcher.send(heapq.heappop(waiting)[2])

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()
        self._socket.close()


def seen_by_motive(record: np.void) -> tuple:
    """Return the body's position and quaternion xyzw in Motive's frame."""
    world = rotation_from_quaternion(MOTIVE_Q) @ UP
    R = rotation_from_quaternion(record["orientation_wxyz"])
    position = record["position"] - R @ PIVOT  # of the body, which is turned as the object is
    q = np.zeros(4)
    quaternion_from_rotation(np.ascontiguousarray(world.T @ R), q)
    return tuple(world.T @ (position - MOTIVE_P)), (*q[1:], q[0])


def main() -> int:
    """Run the trial, and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tracker", choices=("natnet", "udp", "apriltag", "none"), default="natnet")
    parser.add_argument("--version", default="4.1")
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--jitter-ms", type=float, default=20.0)
    parser.add_argument("--ppm", type=float, default=50.0)
    parser.add_argument("--step-s", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([COMMAND, "teach", "ref.mcap"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        watcher: Watcher
        match options.tracker:
            case "natnet":
                watcher = MotiveWatcher(options.version)
            case "udp":
                watcher = UdpWatcher()
            case "apriltag":
                watcher = TagWatcher()
            case _:
                watcher = NoWatcher()
        relay = Relay(watcher, options)
        try:
            with serve("--tracker", relay.address) as served:
                (folder / "cell.toml").write_text(cell_file(watcher))
                cell = ("--cell", f"fci:{served.left},{served.right}", "--cell-file", "cell.toml")
                done = subprocess.run(
                    [COMMAND, "trial", "--reference", "ref.mcap", *cell, "--log", "t.mcap", "--json"],
                    cwd=folder, capture_output=True, text=True, check=False,
                )  # fmt: skip
        finally:
            relay.close()
            watcher.close()
        if not done.stdout:
            print(done.stderr)
            return 1
        result = json.loads(done.stdout)
        print(next((line for line in served.said if "stalls" in line), ""))
        if options.tracker == "none":
            print(f"{result['failure_reason'] or 'success'}; object observed: {result['object_observed']}")
            return int(not result["success"] or result["object_observed"])
        log = read_log(folder / "t.mcap")
        if options.tracker != "apriltag":
            return compared(result, log.topic("/object/pose"), relay.truth)
        status = compared_as_whole(result, log.topic("/object/pose"), relay.truth)
        rendered(log, relay.truth)
        return status


def rendered(log: Log, truth: list) -> None:
    """Print how well the tag is found in what MuJoCo draws of the trial, with the arms where the log has them."""
    arms = [log.topic(f"/{side}/arm") for side in SIDES]
    find, off_mm, first, last, next_ns = detector(CAMERA), [], arms[0]["t_ns"][0], arms[0]["t_ns"][-1], 0
    pictures = 0
    with contextlib.closing(RenderedCell(CAMERA, EYE, BODY)) as cell:
        for t_ns, position, wxyz in truth:
            if not first <= t_ns <= last or t_ns < next_ns:
                continue
            next_ns, pictures = t_ns + PERIOD_NS, pictures + 1
            q = np.array([arm["q"][np.searchsorted(arm["t_ns"], t_ns)] for arm in arms])
            T = find(cell.picture(position, wxyz, q)).get(BODY)
            if T is not None:
                place = (EYE @ T)[:3, 3] - cell.top_m * (EYE @ T)[:3, 2]
                off_mm.append(1e3 * float(np.linalg.norm(place - position)))
    spread = np.percentile(off_mm, [50, 95, 100]) if off_mm else np.zeros(3)
    print("drawn by MuJoCo: found in {} of {} pictures, place p50 {:.2f}, p95 {:.2f}, largest {:.2f} mm".format(
        len(off_mm), pictures, *spread
    ))  # fmt: skip


def cell_file(watcher: Watcher) -> str:
    """Return the cell's file of who has measured where the tracker stands."""
    before, _, after = default_cell_file().read_text().partition("[tracker]\n")
    return before + after[after.index("[start_motion]") :] + f"\n[tracker]\n{watcher.table}"


def compared(result: dict, logged: np.ndarray, truth: list) -> int:
    """Print how far the log's poses are off, in place and time; each is found by its noise, which is its own."""
    times, places = np.array([t for t, _, _ in truth]), np.array([p for _, p, _ in truth])
    off_ms, off_mm = [], []
    for pose in logged:
        frame = int(np.argmin(np.linalg.norm(places - pose["position"], axis=1)))
        off_ms.append(1e-6 * (int(pose["t_ns"]) - times[frame]))
        then = [np.interp(pose["t_ns"], times, places[:, axis]) for axis in range(3)]
        off_mm.append(1e3 * np.linalg.norm(pose["position"] - then))
    ms, mm = (np.percentile(np.abs(off), [50, 95, 100]) for off in (off_ms, off_mm))
    said = result["failure_reason"] or "success"
    print(f"{said}; lift {result['max_lift_mm']} mm, {len(logged)} poses")
    print(f"off in time by more than {MOST_MS:g} ms: {[k for k, off in enumerate(off_ms) if abs(off) > MOST_MS]}")
    print("time  p50 {:.2f}, p95 {:.2f}, largest {:.2f} ms".format(*ms))
    print("place p50 {:.2f}, p95 {:.2f}, largest {:.2f} mm".format(*mm))
    return int(not result["success"] or ms[1] > MOST_MS or mm[1] > MOST_MM)


def compared_as_whole(result: dict, logged: np.ndarray, truth: list) -> int:
    """Print how far the log's poses are off, where each has noise of its own: in place, and all of them in time."""
    times, places = np.array([t for t, _, _ in truth]), np.array([p for _, p, _ in truth])
    if not len(logged):
        print(f"{result['failure_reason'] or 'success'}; no pose arrived: is this machine fast enough to draw them?")
        return 1

    def off_mm(shift_ms: float) -> np.ndarray:
        at = logged["t_ns"] - 1e6 * shift_ms
        then = np.column_stack([np.interp(at, times, places[:, axis]) for axis in range(3)])
        return 1e3 * np.linalg.norm(logged["position"] - then, axis=1)

    shifts = np.arange(-30.0, 30.0, 0.1)
    ms = float(shifts[int(np.argmin([np.mean(off_mm(shift) ** 2) for shift in shifts]))])
    mm = np.percentile(off_mm(0.0), [50, 95, 100])
    print(f"{result['failure_reason'] or 'success'}; lift {result['max_lift_mm']} mm, {len(logged)} poses")
    print(f"time  off by {ms:.1f} ms")
    print("place p50 {:.2f}, p95 {:.2f}, largest {:.2f} mm".format(*mm), flush=True)
    return int(not result["success"] or abs(ms) > MOST_MS or mm[1] > MOST_MM)


if __name__ == "__main__":
    sys.exit(main())
