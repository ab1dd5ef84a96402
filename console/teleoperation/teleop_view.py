"""What a page shows of the input by hand, and what it can choose; and how long a hand takes to reach the torque."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from console.teleoperation.devices import Coupling
from rtstack.log.ring import Rings
from rtstack.topics import HAND_TOPIC

_COMMANDS = 200  # the newest ones, of which the figures are made


class Handles(StrEnum):
    """What a gizmo's handles do. Never both: rings would lie over arrows."""

    MOVE = "move"
    TURN = "turn"


class Lead(StrEnum):
    """Where a clutch that is held leads the hands by itself."""

    UNDO = "undo"  # to where they were asked to be before the last drag
    STRAIGHTEN = "straighten"  # to the nearest orientation that is square to the table


@dataclass(frozen=True, slots=True)
class LatencyView:
    """Median and 95th percentile, ms: from a command's making to its torque, and from the robot state of the picture
    that it answers to that picture being seen.
    """

    to_torque_ms: tuple[float, float]
    to_picture_ms: tuple[float, float]


@dataclass(frozen=True, slots=True)
class TeleopView:
    """What a page shows of the input. refusal: why the last request is not followed, None where it is. drags: how many
    of them can be undone. policy: the name of the policy that leads while the clutch is not held, None where none does;
    policies: of those that are connected. dropped: commands that were not applied since the teleoperation began: too
    old, out of order, made on an old picture, for another reason. picture: what a program has seen by this answer.
    leading: whether a `lead` has not led what is asked for to its end yet.
    """

    held: bool
    coupling: Coupling
    speed_m_s: float
    stiffness_n_m: float
    refusal: str | None
    handles: Handles
    drags: int
    dropped: tuple[int, ...]
    latency: LatencyView | None
    picture: int
    policy: str | None = None
    policies: tuple[str, ...] = ()
    leading: bool = False


class Latency:
    """Reads what the loop says of the commands that it has applied. Not for two threads at a time."""

    def __init__(self, rings: Rings) -> None:
        self._reader = rings.reader(HAND_TOPIC)
        self._seen: deque[tuple[float, float]] = deque(maxlen=_COMMANDS)
        self._view: LatencyView | None = None

    def forget(self) -> None:
        """Begin anew."""
        self._reader.drain()
        self._seen.clear()
        self._view = None

    def view(self) -> LatencyView | None:
        """Return the figures, None before the first command."""
        if len(new := self._reader.drain()):
            self._seen.extend(zip(new["made_us"], new["picture_us"] - new["seen_us"], strict=True))
            low, high = np.percentile(np.array(self._seen) * 1e-3, (50, 95), axis=0).round(1).tolist()
            self._view = LatencyView((low[0], high[0]), (low[1], high[1]))
        return self._view
