"""One word for the whole cell, in each page's top bar. The phase of the arming says what is allowed; this what is so:
a job that is prepared moves nothing, and arms that are disarmed may hold an object.
"""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from console.live.remedies import Remedy, remedy_of
from rtstack.live.protocol import JobState, Phase, Status

MOVED_S = 0.3  # as long an arm counts as moving after its last motion: at a turning point it stands for a moment
HELD_N = 5.0  # the reference-spreading paper, Appendix B: force_high, above which the detector calls it a contact
_SQUEEZE_SAMPLES = 25  # 0.5 s of the watch: a hit is no holding


class CellWord(StrEnum):
    """What the cell does."""

    UNKNOWN = "waiting"
    DISARMED = "disarmed"
    ARMED = "armed"
    PREPARING = "preparing"
    MOVING = "moving"
    HOLDING = "holding"
    RECOVERING = "recovering"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class CellState:
    """The word; `held_n`: with how much both pads squeeze, N, None where they do not; `active`: whether a motion runs
    or begins, so that the arms may move at any moment; `remedy`: what the runbook says of the fault that there is.
    """

    word: CellWord
    held_n: float | None = None
    active: bool = True
    remedy: Remedy | None = None


UNKNOWN = CellState(CellWord.UNKNOWN)


def cell_state(status: Status | None, led: bool, moved: bool, held_n: float | None) -> CellState:
    """Return the state. led: whether all arms have shown a state since the job runs, before which it cannot move them;
    moved: whether an arm has moved within MOVED_S; held_n: of `Squeeze`.
    """
    if status is None:
        return UNKNOWN
    job = status.job
    runs = job is not None and job.active
    active = runs or moved or status.phase in (Phase.MOVING, Phase.RECOVERING)
    if status.phase is Phase.FAULT:
        word = CellWord.FAULT
    elif status.phase is Phase.RECOVERING:
        word = CellWord.RECOVERING
    elif moved:
        word = CellWord.MOVING
    elif runs and job is not None and job.state is not JobState.STARTING and led:
        word = CellWord.HOLDING
    elif status.phase is Phase.MOVING:
        word = CellWord.PREPARING
    elif status.phase is Phase.ARMED:
        word = CellWord.ARMED
    else:
        word = CellWord.DISARMED if held_n is None else CellWord.HOLDING
    return CellState(word, held_n, active, remedy_of(status.reason))


class Squeeze:
    """With how much both pads squeeze what is between them, over the last half second. One alone squeezes nothing."""

    def __init__(self) -> None:
        self._samples: deque[float] = deque(maxlen=_SQUEEZE_SAMPLES)

    def add(self, places: NDArray[np.float64] | None, forces: NDArray[np.float64] | None) -> None:
        """Take the pads' places in the world, (arms, 3) m, and the forces on them, (arms, 3) N; None where unknown."""
        if places is None or forces is None or len(places) == 1:
            self._samples.clear()
            return
        inwards = places[1] - places[0]  # of the left arm; the object pushes the pads apart
        inwards /= max(float(np.linalg.norm(inwards)), 1e-9)
        self._samples.append(min(-float(forces[0] @ inwards), float(forces[1] @ inwards)))

    @property
    def held_n(self) -> float | None:
        """The mean of the smaller one of both pads' forces, N; None below HELD_N."""
        if len(self._samples) < _SQUEEZE_SAMPLES:
            return None
        mean = float(np.mean(self._samples))
        return mean if mean > HELD_N else None
