"""What a page shows of the input by hand, and what it can choose."""

from dataclasses import dataclass
from enum import StrEnum

from console.teleoperation.latency import LatencyView
from console.teleoperation.pair import Coupling


class Handles(StrEnum):
    """What a gizmo's handles do. Never both: rings would lie over arrows."""

    MOVE = "move"
    TURN = "turn"


class Lead(StrEnum):
    """Where a clutch that is held leads the hands by itself."""

    UNDO = "undo"  # to where they were asked to be before the last drag
    STRAIGHTEN = "straighten"  # to the nearest orientation that is square to the table


@dataclass(frozen=True, slots=True)
class TeleopView:
    """What a page shows of the input. refusal: why the last request is not followed, None where it is. drags: how many
    of them can be undone. policy: the name of the policy that leads while the clutch is not held, None where none does.
    dropped: commands that were not applied since the teleoperation began: too old, out of order, made on an old
    picture, for another reason. picture: what a program that asks nothing else has seen by this answer. policies: the
    names of those that are connected.
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
