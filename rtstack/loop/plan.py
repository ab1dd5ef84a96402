"""What a session follows: points that are there already, or that a source writes tick by tick."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rtstack.control.controller import ObservedArm
from rtstack.safety.judge import ForcePhase
from rtstack.samples import Mode


class PointSource(Protocol):
    """Writes the plan's points during the session, which has no end of its own then."""

    @property
    def points(self) -> NDArray[np.void]:
        """The points (arms, 1) of POINT that are written."""
        ...

    def listen(self) -> None:
        """Take what has come since the last tick: requests, what the arms have reached. Once a tick, before `step`,
        and before this source is asked as a watchdog, which it has to be. Never waits."""

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the point of an arm, by its place among the arms, whose state was just observed. Never waits."""


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """What to follow: ante and post (arms, n) of POINT, the mode to begin with, and the stiffness (6,). source: writes
    ante[:, 0] each tick; None for references that are there already. phase: what the pads are to do. impact_s: between
    which two moments an impact is meant, s since the start: until it is detected the forces are those of contact, from
    then on those of an impact, and outside those of `phase`."""

    ante: NDArray
    post: NDArray
    mode: Mode
    stiffness: NDArray[np.floating]
    period_s: float
    source: PointSource | None = None
    phase: ForcePhase = ForcePhase.APPROACH
    impact_s: tuple[float, float] | None = None

    @classmethod
    def from_source(
        cls, source: PointSource, stiffness: NDArray[np.floating], period_s: float, phase: ForcePhase
    ) -> "SessionPlan":
        """Return the plan whose only point the source writes anew each tick."""
        return cls(source.points, source.points, Mode.TELEOPERATION, stiffness, period_s, source, phase)

    @property
    def widest_phase(self) -> ForcePhase:
        """The phase of the largest forces: what the robots' own thresholds have to let pass, which do not change."""
        return self.phase if self.impact_s is None else ForcePhase.IMPACT

    @property
    def ticks(self) -> int:
        """Length of the reference in ticks."""
        return self.ante.shape[1]
