"""`rtstack sim` that shows what truly happens in its plant: watched_robot.py FILE PRELUDE, then its options.

FILE is a record (WATCHED) in shared memory, which a program reads while the robot runs, and after it was killed.
PRELUDE is Python, carried out before: for a robot that is otherwise wrong.
"""

import mmap
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.state import RobotMode

ARMS = 2
KEPT = 1 << 16  # milliseconds of the robot, for which the host's time is kept
CLASSES = ("link", "pad on table", "pad on pad", "pad on object")  # of contacts; link: with anything
WATCHED = np.dtype([
    ("ticks", "i8"),  # of the plant, ms
    ("moving_ticks", "i8"),  # with a client's motion
    ("driven", "i1", ARMS),  # whether a client moves the arm now
    ("turned", "f8", ARMS),  # how far a joint has been from its place at the start, rad
    ("pads", "f8", (ARMS, 3)),  # the middle of each pad's face in the world, m: now, at the start, at its extremes
    ("began", "f8", (ARMS, 3)), ("lowest", "f8", (ARMS, 3)), ("highest", "f8", (ARMS, 3)),
    ("contact", "f8", len(CLASSES)),  # largest normal force, N, of an arm's contacts of a class in a millisecond
    ("lifted", "f8"), ("lifted_most", "f8"),  # the object, m above its place
    ("falling", "f8"),  # its largest speed downwards, m/s
    ("left_ns", "i8", ARMS),  # host's monotonic time at which the arm last left a motion
    ("cut", "i1", ARMS),  # set by who reads: the arm's network cable is out, nothing comes or goes
    ("taken_ns", "i8", (ARMS, KEPT)),  # and at which the plant took the answer to the state of so many ms
])  # fmt: skip


def opened(path: Path, new: bool = False) -> NDArray:
    """Return the record (1,) in a file."""
    if new:
        path.write_bytes(bytes(WATCHED.itemsize))
    with path.open("r+b") as file:
        return np.frombuffer(mmap.mmap(file.fileno(), WATCHED.itemsize), WATCHED)


class Watch:
    """Looks at a server's plant in each millisecond."""

    def __init__(self, server, record: np.void) -> None:
        self._server, self._record, plant = server, record, server.cell.plant
        self._plant, self._data, model = plant, plant.data, plant.model
        arms = len(plant.pad_bodies)
        self._joints = self._data.qpos[: 7 * arms].copy()
        self._arms = slice(0, arms)
        self._class = np.zeros(model.ngeom, dtype=np.int64)  # 0 what stands there, 1 the object, 2 a pad, 4 a link
        self._right = np.zeros(model.ngeom, dtype=np.int64)  # 1 of the right arm
        object_body = model.body("object").id
        self._height = float(self._data.xpos[object_body][2])
        self._object_body, self._falls = object_body, 7 * arms + 2
        for geom, body in enumerate(model.geom_bodyid):
            name = model.body(body).name
            link = name.startswith(("left_", "right_"))
            self._right[geom] = name.startswith("right_")
            self._class[geom] = 1 if body == object_body else 2 if body in plant.pad_bodies else 4 if link else 0
        self._force = np.zeros(6)
        for side, arm_server in enumerate(server.arm_servers):
            link = arm_server.link
            link._send_state = partial(self._unless_cut, side, link._send_state)
            arm_server.take = partial(self._unless_cut, side, arm_server.take)
        for name in ("pads", "began", "lowest", "highest"):
            record[name][self._arms] = self._pads()

    def _unless_cut(self, side: int, do: Callable[[Any], None], datagram: Any) -> None:
        if not self._record["cut"][side]:
            do(datagram)

    def _pads(self) -> NDArray[np.float64]:
        data, plant = self._data, self._plant
        bodies = list(plant.pad_bodies)
        turned = data.xmat[bodies].reshape(-1, 3, 3) @ plant.face_in_pad[:, :, None]
        return data.xpos[bodies] + turned[:, :, 0]

    def before(self) -> None:
        """Note when the plant takes the answers to the states that were shown last."""
        now_ns = time.monotonic_ns()
        for side, arm_server in enumerate(self._server.arm_servers):
            self._record["taken_ns"][side, arm_server.message_id % KEPT] = now_ns

    def after(self) -> None:
        """Look at the plant."""
        record, data = self._record, self._data
        driven = [arm_server.box.mode == RobotMode.MOVE for arm_server in self._server.arm_servers]
        for side, now in enumerate(driven):
            if record["driven"][side] and not now:
                record["left_ns"][side] = time.monotonic_ns()
            record["driven"][side] = now
        record["ticks"] += 1
        record["moving_ticks"] += any(driven)
        turned = np.abs(data.qpos[: len(self._joints)] - self._joints).reshape(-1, 7).max(axis=1)
        record["turned"][self._arms] = np.maximum(record["turned"][self._arms], turned)
        pads = record["pads"][self._arms] = self._pads()
        record["lowest"][self._arms] = np.minimum(record["lowest"][self._arms], pads)
        record["highest"][self._arms] = np.maximum(record["highest"][self._arms], pads)
        if not self._plant.away:
            record["lifted"] = data.xpos[self._object_body][2] - self._height
            record["lifted_most"] = max(record["lifted_most"], record["lifted"])
            record["falling"] = max(record["falling"], -data.qvel[self._falls])
        if not data.ncon:
            return
        geoms = data.contact.geom
        kinds, right = np.sort(self._class[geoms], axis=1), self._right[geoms].max(axis=1)
        sums = np.zeros((ARMS, len(CLASSES)))
        for number in np.flatnonzero(kinds[:, 1] >= 2):
            mujoco.mj_contactForce(self._plant.model, data, number, self._force)
            low, high = kinds[number]
            sums[right[number], 0 if high == 4 else (1, 3, 2)[low]] += self._force[0]
        np.maximum(record["contact"], sums.max(axis=0), out=record["contact"])


def main() -> None:
    """Serve, watched."""
    path, prelude, options = Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
    from rtstack.cli import main as rtstack
    from sim_robot.fci.server import Server

    exec(prelude, {})
    begin, advance = Server.__init__, Server.advance
    record = opened(path)

    def watched_init(self, *arguments, **more) -> None:
        begin(self, *arguments, **more)
        self.watch = Watch(self, record[0])

    def watched_advance(self) -> None:
        self.watch.before()
        advance(self)
        self.watch.after()

    Server.__init__, Server.advance = watched_init, watched_advance
    sys.argv = ["rtstack", "sim", *options]
    rtstack()


if __name__ == "__main__":
    main()
