"""What one arm has shown and was sent while a step ran, with the host's times, and how long its box took.

Nothing here changes a torque. On purpose an answer may be left out, as if it were lost, and collision thresholds may be
lowered.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hal.arm import Arm
from hal.cell import LEFT, ArmLink, Cell
from hal.limits import CollisionBehaviour
from hal.state import ARM_STATE, ArmState

T = TypeVar("T")

ROOM = 60_000  # states of a step: a minute


@dataclass(frozen=True, slots=True)
class Rows:
    """What was kept, a row a state. state: of ARM_STATE; tau (n, 7): what answered it, Nm, NaN where nothing did; sent:
    whether that went out; read_ns, answered_ns: of the host's monotonic clock."""

    state: NDArray[np.void]
    tau: NDArray[np.float64]
    sent: NDArray[np.bool_]
    read_ns: NDArray[np.int64]
    answered_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.state)

    def __getitem__(self, part: slice) -> "Rows":
        return Rows(*(getattr(self, name)[part] for name in Rows.__slots__))

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays for a file: states and torques in single precision, times and positions as they are."""
        names = self.state.dtype.names or ()
        exact = ("t_ns", "q", "robot_mode", "current_errors")
        found = {name: self.state[name] if name in exact else self.state[name].astype("f4") for name in names}
        found |= {"tau_sent": self.tau.astype("f4"), "sent": self.sent}
        return found | {"read_ns": self.read_ns, "answered_ns": self.answered_ns}


class RecordedArm:
    """A hal.arm.Arm that passes everything on and keeps it; beyond ROOM nothing is kept.

    lose: numbers of answers, counted from the last `clear`, that are not sent.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._kept = Rows(
            np.zeros(ROOM, ARM_STATE), np.zeros((ROOM, 7)), np.zeros(ROOM, np.bool_), np.zeros(ROOM, np.int64),
            np.zeros(ROOM, np.int64),
        )  # fmt: skip
        for name in Rows.__slots__:  # every page is there before an arm moves
            getattr(self._kept, name).view(np.uint8).fill(0)
        self._bytes = self._kept.state.view(np.uint8).reshape(ROOM, -1)
        self._answers = 0
        self.count = 0
        self.lose: frozenset[int] = frozenset()

    @property
    def rows(self) -> Rows:
        """A copy of what was kept since the last `clear`."""
        return Rows(*(getattr(self._kept, name)[: self.count].copy() for name in Rows.__slots__))

    def clear(self) -> None:
        """Forget what was kept."""
        self.count = self._answers = 0
        self.lose = frozenset()

    def read(self) -> ArmState:
        state, n = self._arm.read(), self.count
        if n < ROOM:
            kept = self._kept
            kept.read_ns[n] = time.monotonic_ns()
            self._bytes[n] = state.record.view(np.uint8)
            kept.tau[n], kept.sent[n], kept.answered_ns[n] = np.nan, False, 0
            self.count = n + 1
        return state

    def write(self, tau: NDArray[np.float64]) -> None:
        lost = self._answers in self.lose
        self._answers += 1
        if not lost:
            self._arm.write(tau)
        n = self.count - 1
        if n >= 0:
            kept = self._kept
            kept.tau[n], kept.sent[n], kept.answered_ns[n] = tau, not lost, time.monotonic_ns()

    def stop(self) -> None:
        self._arm.stop()

    def recover(self) -> None:
        self._arm.recover()

    def close(self) -> None:
        self._arm.close()


class TimedLink:
    """A hal.cell.ArmLink that notes how long each start, stop and recovery took, s, and at which row it began.

    tighter: thresholds in the place of those that a run asks for; they have to be lower.
    """

    def __init__(self, link: ArmLink, arm: RecordedArm) -> None:
        self._link, self._arm = link, arm
        self.wait = link.wait
        self.tighter: CollisionBehaviour | None = None
        self.clear()

    def clear(self) -> None:
        """Forget what was noted."""
        self.starts: list[tuple[int, float]] = []
        self.stops: list[tuple[int, float]] = []
        self.recoveries: list[tuple[int, float]] = []
        self.recovered: tuple[str, ...] = ()  # from what

    def start(self) -> None:
        self._timed(self.starts, self._link.start)

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        self._timed(self.stops, lambda: self._link.stop(first, at_rest=at_rest))

    def recover(self) -> tuple[str, ...]:
        self.recovered = self._timed(self.recoveries, self._link.recover)
        return self.recovered

    def set_collisions(self, *arms: CollisionBehaviour) -> None:
        if self.tighter is not None:
            lower = zip(self.tighter.collision_forces, arms[0].collision_forces, strict=True)
            assert all(mine <= asked for mine, asked in lower), "thresholds are only ever lowered here"
            arms = (self.tighter,)
        self._link.set_collisions(*arms)

    def close(self) -> None:
        self._link.close()

    def _timed(self, noted: list[tuple[int, float]], call: Callable[[], T]) -> T:
        began = time.perf_counter()
        row = self._arm.count
        try:
            return call()
        finally:
            noted.append((row, time.perf_counter() - began))


def recorded(cell: Cell) -> tuple[Cell, RecordedArm, TimedLink]:
    """Return the cell of one arm whose arm is kept, the arm and its link."""
    (arm,) = cell.arms
    assert cell.link is not None, "an arm behind the Franka Control Interface has a link"
    kept = RecordedArm(arm)
    link = TimedLink(cell.link, kept)
    return replace(cell, link=link, **{cell.sides[0]: kept}), kept, link
