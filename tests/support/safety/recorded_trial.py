"""A recorded trial, judged once more: states, desired torques and residuals from its MCAP, through the judge alone."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.safety.geometry import arm_distance
from rtstack.safety.judge import Base, Cause, SafetyJudge, SafetyLimits, judge
from rtstack.safety.judge import judges_of as make_judges
from rtstack.samples import ARM_SAMPLE, SIDES, Mode

FAR_M = 9.0

Judges = Callable[[SafetyLimits], tuple[SafetyJudge, ...]]


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run up to its stop: arms (2, n) of ARM_SAMPLE, residuals (2, n, 7) Nm; with_stop (2, m): the whole of it."""

    arms: np.ndarray
    residuals: np.ndarray
    with_stop: np.ndarray

    def changed(self) -> "Recorded":
        """Return a copy that may be written to."""
        return Recorded(self.arms.copy(), self.residuals.copy(), self.with_stop)


@dataclass(frozen=True, slots=True)
class Places:
    """Where the judge saw the arms of a run: face (2, n, 3) m, speed (2, n) m/s, power (2, n) W, distance (n,) m."""

    face: np.ndarray
    speed: np.ndarray
    power: np.ndarray
    distance: np.ndarray


@dataclass(frozen=True, slots=True)
class Intervention:
    """The first one: why, when, and whether both arms were stopping one tick later (a torque is only limited)."""

    reason: Cause
    tick: int
    both: bool


def read_recorded(path: Path) -> Recorded:
    """Read a run's log."""
    log = read_log(path)
    topics = [log.topic(f"/{side}/arm") for side in SIDES]
    controls = [log.topic(f"/{side}/control") for side in SIDES]
    arms = np.zeros((2, min(map(len, topics))), ARM_SAMPLE)
    for side, topic in enumerate(topics):
        for name in ARM_SAMPLE.names or ():
            arms[name][side] = topic[name][: arms.shape[1]]
    residuals = np.array([c["momentum_residual"][: arms.shape[1]] for c in controls])
    stopping = int(np.flatnonzero(controls[0]["mode"] == Mode.STOPPING)[0])
    return Recorded(arms[:, :stopping], residuals[:, :stopping], arms)


def judges_of(cell: CellDescription) -> Judges:
    """Return what makes the pair of judges of a cell, with any limits."""
    bases = [Base(m.base_position, m.base_orientation_wxyz) for m in cell.arms]
    return lambda limits: make_judges((limits, limits), bases, cell.tools)


def replay(trial: Recorded, pair: tuple[SafetyJudge, ...], places: Places | None = None) -> Intervention | None:
    """Judge a run tick by tick as its session did; return the first intervention. places: to be written."""
    sample = np.zeros(1, ARM_SAMPLE)
    views = [(one.memory, one._other, one._rules) for one in pair]
    for k in range(trial.arms.shape[1]):
        for side, (memory, other, rules) in enumerate(views):
            sample[0] = trial.arms[side, k]
            verdict, reason = judge(sample, trial.residuals[side, k], memory, other, rules, 0)
            if verdict != 0:
                last = min(k + 1, trial.arms.shape[1] - 1)
                for other_side, (mine, others, rule) in enumerate(views):
                    sample[0] = trial.arms[other_side, last]
                    judge(sample, trial.residuals[other_side, last], mine, others, rule, 0)
                return Intervention(Cause(reason), k, all(one.stopping for one in pair))
            if sample["tau_applied"].tobytes() != trial.arms["tau_applied"][side, k].tobytes():
                raise ValueError(f"tick {k}: the log's torque is not the one that the judge lets through")
            if places is not None:
                _note(places, side, k, sample[0], memory[0], other[0], rules[0])
    return None


def empty_places(trial: Recorded) -> Places:
    """Return places (2, n) to be written."""
    n = trial.arms.shape[1]
    return Places(np.zeros((2, n, 3)), np.zeros((2, n)), np.zeros((2, n)), np.full(n, FAR_M))


def _note(places: Places, side: int, k: int, sample: np.void, mine: np.void, other: np.void, rule: np.void) -> None:
    places.face[side, k] = mine["face_world"]
    places.speed[side, k] = np.linalg.norm(mine["face_velocity"])
    places.power[side, k] = abs(sample["tau_J"] @ sample["dq"])
    if other["placed"]:
        places.distance[k] = min(places.distance[k], arm_distance(mine, other, rule, FAR_M))


def furthest(trial: Recorded, places: Places) -> dict[str, tuple[list[float], list[float]]]:
    """Return the lowest and the highest of what the limits are about, over both arms."""
    values = {name: np.abs(trial.arms[name]) for name in ("dq", "tau_desired", "tau_J", "tau_ext_hat_filtered")}
    values |= {"q": trial.arms["q"], "residual": np.abs(trial.residuals), "face": places.face}
    values |= {"speed": places.speed[..., None], "power": places.power[..., None]}
    values["distance of the arms"] = np.stack([places.distance[1:]] * 2)[..., None]
    return {name: (v.min(axis=(0, 1)).tolist(), v.max(axis=(0, 1)).tolist()) for name, v in values.items()}
