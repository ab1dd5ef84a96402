"""A trial on served arms whose object Motive watches, through a bad network: where and when the log has the object.

`python -m tests.programs.tracked_trial [--version 4.1] [--loss 0.05] [--jitter-ms 20] [--ppm 50] [--step-s 3600]`

The poses of the simulated tracker are turned into what Motive sends (its y is up, it stands elsewhere, follows a body
beside the object, and has a clock of its own that steps once), delayed, dropped and overtaken; `rtstack trial` reads
them by `kind = "natnet"`. Each pose in the log is compared with the simulated tracker's own pose and time. In real
time. Exit status 1 where the trial fails or the log is off by more than 2 mm or 5 ms (95 of 100 poses).
"""

import argparse
import heapq
import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hal.tracker_link import DATAGRAM
from rtstack.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.model.rotation import quaternion_from_rotation, rotation_from_quaternion
from tests.support.fci.server import serve
from tests.support.trackers.motive import Motive

COMMAND = Path(sys.executable).with_name("rtstack")
BODY = 42
MOTIVE_P, MOTIVE_Q = np.array([0.6, -0.2, 0.1]), np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])  # in the world
PIVOT = np.array([0.02, -0.03, 0.09])  # of the object in the body
UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from Motive's axes to those with z up
MOST_MM, MOST_MS = 2.0, 5.0


class Relay:
    """What stands between the simulated tracker and the client: Motive, and a bad network."""

    def __init__(self, motive: Motive, options: argparse.Namespace) -> None:
        self.truth: list[tuple[int, np.ndarray]] = []
        self._motive, self._options, self._rng = motive, options, np.random.default_rng(options.seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(1e-3)
        self.address = "{}:{}".format(*self._socket.getsockname())
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        waiting: list[tuple[float, int, float, tuple]] = []
        steps_at_s = None
        while not self._over.is_set():
            try:
                (record,) = np.frombuffer(self._socket.recv(256), DATAGRAM)
            except TimeoutError:
                record = None
            now_s = time.monotonic()
            if record is not None:
                self.truth.append((int(record["t_ns"]), record["position"].copy()))
                if steps_at_s is None and self._motive.client is not None:
                    steps_at_s = now_s + self._options.step_after_s
                if self._rng.random() >= self._options.loss:
                    stamp_s = 1000.0 + (1.0 + 1e-6 * self._options.ppm) * 1e-9 * int(record["t_ns"])
                    stamp_s += self._options.step_s * (steps_at_s is not None and now_s > steps_at_s)
                    due_s = now_s + 1e-3 * self._options.jitter_ms * self._rng.random()
                    heapq.heappush(waiting, (due_s, len(self.truth), stamp_s, seen_by_motive(record)))
            while waiting and waiting[0][0] <= now_s:
                _, _, stamp_s, (position, xyzw) = heapq.heappop(waiting)
                self._motive.send(
                    stamp_s, [(1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), True), (BODY, position, xyzw, True)]
                )

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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", default="4.1")
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--jitter-ms", type=float, default=20.0)
    parser.add_argument("--ppm", type=float, default=50.0)
    parser.add_argument("--step-s", type=float, default=3600.0)
    parser.add_argument("--step-after-s", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([COMMAND, "teach", "ref.mcap"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        motive = Motive(tuple(map(int, options.version.split("."))))
        relay = Relay(motive, options)
        try:
            with serve("--tracker", relay.address) as served:
                (folder / "cell.toml").write_text(cell_file(motive))
                cell = ("--cell", f"fci:{served.left},{served.right}", "--cell-file", "cell.toml")
                done = subprocess.run(
                    [COMMAND, "trial", "--reference", "ref.mcap", *cell, "--log", "t.mcap", "--json"],
                    cwd=folder, capture_output=True, text=True, check=False,
                )  # fmt: skip
        finally:
            relay.close()
            motive.close()
        if not done.stdout:
            print(done.stderr)
            return 1
        result = json.loads(done.stdout)
        return compared(result, read_log(folder / "t.mcap").topic("/object/pose"), relay.truth)


def cell_file(motive: Motive) -> str:
    """Return the cell's file of who has measured where Motive stands."""
    where = f"""[tracker]
kind = "natnet"
up = "y"
position = {MOTIVE_P.tolist()}
orientation_wxyz = {MOTIVE_Q.tolist()}
largest_age_ms = 100.0
"""
    body = f"[tracker.bodies.rice_box]\nid = {BODY}\nposition = {PIVOT.tolist()}\n"
    text = default_cell_file().read_text().replace("[tracker]\n", where)
    return text.replace('"127.0.0.1:1341"', '"{}:{}"'.format(*motive.address)) + body


def compared(result: dict, logged: np.ndarray, truth: list) -> int:
    """Print how far the log's poses are off, in place and time; each is found by its noise, which is its own."""
    times, places = np.array([t for t, _ in truth]), np.array([p for _, p in truth])
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


if __name__ == "__main__":
    sys.exit(main())
