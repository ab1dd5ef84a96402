"""Every limit of the judge, brought into reach of a recorded trial: tightened to inside what the log contains.

What is no limit to tighten (finite values, a clock that runs, a state that is new) is changed in the log instead.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rtstack.safety.judge import Cause, ForcePhase, SafetyLimits
from tests.support.safety.recorded_trial import Intervention, Judges, Places, Recorded, replay

INSIDE = 0.1  # of the range: how far inside the furthest value the line is drawn

# the names of the cases: each has to be reached in every trial
LIMITS = (
    "q_lower", "q_upper", "dq_max", "tau_max", "tau_rate_max", "tau_J_max", "tau_ext_max, robot's estimate",
    "tau_ext_max, residual", "tau_ext_contact_max", "tau_ext_approach_max", "force_max", "force_contact_max",
    "force_approach_max", "power_max", "ee_lower", "ee_upper", "ee_speed_max", "arm_distance_min",
    "state_gap_max_s", "state_gap_max_s, repeated state", "pair_skew_max_s", "clock", "finite values",
)  # fmt: skip
# a joint that approaches its line is stopped by what the line allows as a velocity before it is beyond
POSITION = frozenset((Cause.JOINT_POSITION, Cause.JOINT_VELOCITY))
ONE_TORQUE = frozenset((Cause.TORQUE, Cause.TORQUE_RATE))  # limited, not stopped
STATE = ("q", "dq", "tau_J")


@dataclass(frozen=True, slots=True)
class Case:
    """A limit in reach. detail: which joint, axis or field; expected: the reasons that it may have."""

    limit: str
    detail: str
    limits: SafetyLimits
    trial: Recorded
    expected: frozenset[Cause]
    phase: ForcePhase = ForcePhase.IMPACT

    def seen(self, judges: Judges) -> Intervention | None:
        """Judge the trial with the limits, all of it as this phase."""
        pair = judges(self.limits)
        for one in pair:
            one.expect(self.phase)
        return replay(self.trial, pair)

    def reached_by(self, seen: Intervention | None) -> bool:
        """Whether this is the intervention that the limit calls for: a stop of both arms, or a torque that is less."""
        return seen is not None and seen.reason in self.expected and (seen.both or seen.reason in ONE_TORQUE)


def cases(trial: Recorded, places: Places, stock: SafetyLimits) -> Iterator[Case]:
    """Yield every limit that this trial can reach. Where one is missing, the trial does not reach it."""
    for limit, detail, table, reasons in _tables(trial, places, stock):
        yield Case(limit, detail, stock.tightened(table), trial, frozenset(reasons), _phase(limit))
    for limit, detail, table, changed, reason in _changes(trial):
        yield Case(limit, detail, stock.tightened(table), changed, frozenset([reason]))


def _phase(limit: str) -> ForcePhase:
    return next((phase for phase in ForcePhase if phase.name.lower() in limit), ForcePhase.IMPACT)


Table = tuple[str, str, dict[str, object], frozenset[Cause] | tuple[Cause, ...]]


def _tables(trial: Recorded, places: Places, stock: SafetyLimits) -> Iterator[Table]:
    q, arms = trial.arms["q"], trial.arms
    for j in range(7):
        joint, low, high = f"joint {j + 1}", float(q[..., j].min()), float(q[..., j].max())
        margin = INSIDE * (high - low)
        yield "q_lower", joint, _one(stock, "q_lower", j, low + margin), POSITION
        yield "q_upper", joint, _one(stock, "q_upper", j, high - margin), POSITION
        for name, field, reason in (
            ("dq_max", "dq", Cause.JOINT_VELOCITY),
            ("tau_max", "tau_desired", Cause.TORQUE),
            ("tau_J_max", "tau_J", Cause.MEASURED_TORQUE),
        ):
            line = (1.0 - INSIDE) * np.abs(arms[field][..., j]).max()
            yield name, joint, _one(stock, name, j, line), (reason,)
        estimate, residual = np.abs(arms["tau_ext_hat_filtered"][..., j]), np.abs(trial.residuals[..., j])
        for what, mine, others, reason in (
            ("robot's estimate", estimate, residual, Cause.EXTERNAL_TORQUE),
            ("residual", residual, estimate, Cause.RESIDUAL),
        ):
            line = _line_before(mine.max(axis=0), others.max(axis=0))
            if line is not None:
                yield f"tau_ext_max, {what}", joint, _one(stock, "tau_ext_max", j, line), (reason,)
    for phase in ("contact", "approach"):
        name = f"tau_ext_{phase}_max"
        both = np.maximum(np.abs(arms["tau_ext_hat_filtered"][..., 0]), np.abs(trial.residuals[..., 0]))
        table = _one(stock, name, 0, (1.0 - INSIDE) * float(both.max()))
        yield name, "joint 1", table, (Cause.EXTERNAL_TORQUE, Cause.RESIDUAL)
    force = (1.0 - INSIDE) * float(np.linalg.norm(arms["O_F_ext_hat_K"][..., :3], axis=-1).max())
    for name in ("force_max", "force_contact_max", "force_approach_max"):
        yield name, "", {name: force}, (Cause.FORCE,)
    for a, axis in enumerate("xyz"):
        low, high = float(places.face[..., a].min()), float(places.face[..., a].max())
        margin = INSIDE * (high - low)
        yield "ee_lower", axis, _one(stock, "ee_lower", a, low + margin), (Cause.WORKSPACE,)
        yield "ee_upper", axis, _one(stock, "ee_upper", a, high - margin), (Cause.WORKSPACE,)
    share = 1.0 - INSIDE
    closest = float(places.distance.min())
    apart = closest + INSIDE * (float(places.distance.max()) - closest)
    first = np.zeros((2, 1, 7))  # torque control begins at zero
    steps = np.abs(np.diff(np.concatenate([first, arms["tau_desired"]], axis=1), axis=1))
    yield "ee_speed_max", "", {"ee_speed_max": share * float(places.speed.max())}, (Cause.SPEED,)
    yield "power_max", "", {"power_max": share * float(places.power.max())}, (Cause.POWER,)
    yield "arm_distance_min", "", {"arm_distance_min": apart}, (Cause.ARM_DISTANCE,)
    yield "tau_rate_max", "", {"tau_rate_max": share * float(steps.max()) / 1e-3}, (Cause.TORQUE_RATE,)
    gap_s = share * float(np.diff(arms["t_ns"])[:, 1:].max()) * 1e-9
    yield "state_gap_max_s", "", {"state_gap_max_s": gap_s}, (Cause.STATE_GAP,)
    yield "pair_skew_max_s", "", {"pair_skew_max_s": gap_s}, (Cause.PAIR_SKEW,)


def _changes(trial: Recorded) -> Iterator[tuple[str, str, dict[str, object], Recorded, Cause]]:
    middle = trial.arms.shape[1] // 2
    changed = trial.changed()
    for name in STATE:
        changed.arms[name][1, middle + 1 : middle + 3] = changed.arms[name][1, middle]
    yield "state_gap_max_s, repeated state", "", {"state_gap_max_s": 0.0015}, changed, Cause.STATE_AGE
    changed = trial.changed()
    changed.arms["t_ns"][0, middle] -= 2_000_000
    yield "clock", "back by 2 ms", {}, changed, Cause.TIME_BACKWARDS
    for name in (*STATE, "tau_ext_hat_filtered", "tau_desired", "O_F_ext_hat_K", "O_T_EE", "residual"):
        changed = trial.changed()
        field = changed.residuals if name == "residual" else changed.arms[name]
        field[1, middle].reshape(-1)[middle % field[1, middle].size] = np.nan
        yield "finite values", name, {}, changed, Cause.NOT_FINITE


def _one(stock: SafetyLimits, name: str, index: int, line: float) -> dict[str, object]:
    """Return the table that moves one of a limit's lines."""
    lines = [float(np.clip(value, -1e3, 1e3)) for value in getattr(stock, name)]
    lines[index] = float(line)
    return {name: lines}


def _line_before(mine: np.ndarray, others: np.ndarray) -> float | None:
    """Return a line that `mine` (n,) crosses before `others` (n,) does, well inside, None where there is none."""
    margin = mine - np.maximum.accumulate(others)
    k = int(np.argmax(margin))
    return float(mine[k] - margin[k] / 2.0) if margin[k] > 0.0 else None
