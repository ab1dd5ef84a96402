"""The judges of the paper's claims, which its plan has in words: what a campaign says about each."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from rtstack.experiments.claims import Claim, ClaimStatus, at_least, at_most, combined, shown
from rtstack.experiments.experiment import Row
from rtstack.experiments.registration import Finding, Judge, PlannedClaim, judged
from rtstack.experiments.statistics import Interval, plain_mean, proportion
from rtstack.papers.reference_spreading.controllers import NAMES, Controller
from rtstack.papers.reference_spreading.evaluation import FIGURE11, TABLE2, Evaluation, Value, every, place_of, went_on

NO_RS, NO_VELOCITY, NO_INTERIM, PROPOSED = (
    Controller.NO_REFERENCE_SPREADING, Controller.NO_VELOCITY_FEEDBACK, Controller.NO_INTERIM, Controller.PROPOSED,
)  # fmt: skip
# what the marks of the plans say in words
TENTH, HALF, MOST = 0.1, 0.5, 0.9
AT_ONCE_MS = 2.0
UNSETTLED_MS = 500.0  # a time that is not over by then counts as this

ControllerValue = Callable[[Controller], Interval | None]


def judge_claims(claims: Sequence[PlannedClaim], evaluation: Evaluation) -> list[Claim]:
    """Return the plan's claims with their verdicts, those left out that this plan's experiments cannot judge."""
    displacements = {row["displacement_mm"] for row in evaluation.rows}
    has = {row["experiment"] for row in evaluation.rows}
    known = [
        claim for claim in claims
        if (claim.at in displacements or not isinstance(claim.at, float))
        and ({TABLE2, FIGURE11} & has) and (FIGURE11 in has or claim.judge != "repeatable")
    ]  # fmt: skip
    return judged(known, JUDGES, evaluation)


def _each(value: ControllerValue, unit: str = "", digits: int = 1, factor: float = 1.0) -> str:
    return "; ".join(f"{name.lower()} {shown(value(c), unit, digits, factor)}" for c, name in NAMES.items())


def _below_zero(interval: Interval | None) -> ClaimStatus:
    """The verdict of "the mean is below 0": UNDECIDED where all values are 0, since nothing tells them apart."""
    if interval is not None and interval.low == interval.high == 0.0:
        return ClaimStatus.UNDECIDED
    return at_most(interval, 0.0)


def _lower(
    evaluation: Evaluation, pairs: Iterable[tuple[Controller, Controller]], value: str | Value, **how: Any
) -> tuple[ClaimStatus, str]:
    """Judge that the first is below the second of each pair; return the verdict and the differences in words."""
    unit, digits = how.pop("unit", ""), how.pop("digits", 1)
    found = [(a, b, evaluation.difference(a, b, value, **how)) for a, b in pairs]
    words = "; ".join(f"{NAMES[a].lower()} less {NAMES[b].lower()} {shown(d, unit, digits)}" for a, b, d in found)
    return combined(_below_zero(d) for _, _, d in found), words


def _against(first: Controller, others: Iterable[Controller] = NAMES) -> list[tuple[Controller, Controller]]:
    return [(first, other) for other in others if other is not first]


def _compared(
    column: str | Value, pairs: Sequence[tuple[Controller, Controller]], unit: str = "", digits: int = 1, why: str = ""
) -> Judge:
    def judge(evaluation: Evaluation, _at: object) -> Finding:
        verdict, words = _lower(evaluation, pairs, column, unit=unit, digits=digits)
        return Finding(f"{_each(lambda c: evaluation.mean(c, column), unit, digits)}. Pairs: {words}", verdict, why)

    return judge


def _force_at(evaluation: Evaluation, at: float, pairs: list[tuple[Controller, Controller]]) -> Finding:
    where = FIGURE11 if evaluation.of(FIGURE11, displacement_mm=at) else TABLE2
    verdict, words = _lower(evaluation, pairs, "average_force_norm", experiment=where, displacement_mm=at)
    return Finding(f"{_each(lambda c: evaluation.mean_force(c, at, experiment=where))}. Pairs: {words}", verdict)


def _grabs(evaluation: Evaluation, pairs: list[tuple[Controller, Controller]]) -> Finding:
    verdict, words = _lower(evaluation, pairs, "success", digits=2, counted=every, experiment=TABLE2)
    shares = _each({line.controller: line.success for line in evaluation.table2()}.get, " %", 0, 100.0)
    return Finding(f"{shares}. Share, pairs: {words}", verdict, _why_grabs(evaluation))


def _why_grabs(evaluation: Evaluation) -> str:
    highest = max((row["peak_torque_ratio"] or 0.0 for row in evaluation.of(TABLE2)), default=0.0)
    failed = "; ".join(f"{why}: " + ", ".join(f"{NAMES[Controller(c)].lower()} {n}" for c, n in by.items())
                       for why, by in evaluation.failures().items())  # fmt: skip
    return f"Highest joint torque {100.0 * highest:.0f} % of its limit. Failures: {failed or 'none'}."


def _lift_order(evaluation: Evaluation, at: str) -> Finding:
    """at: the controller that is below those that the paper has above it."""
    above = {
        NO_VELOCITY: (NO_RS, NO_INTERIM, PROPOSED), NO_INTERIM: (PROPOSED, NO_RS), PROPOSED: (NO_RS,),
    }[Controller(at)]  # fmt: skip
    pairs = _against(Controller(at), above)
    how = {"unit": " mm", "digits": 2, "experiment": TABLE2, "success": True}  # as the paper does for the lift
    verdict, words = _lower(evaluation, pairs, "max_lift_mm", counted=every, **how)
    lift = {line.controller: line.lift_mm for line in evaluation.table2()}
    return Finding(f"{_each(lift.get, ' mm', 2)}. Pairs in which both succeeded: {words}", verdict)


def _dropped(evaluation: Evaluation, _at: object) -> Finding:
    rows = [row for row in evaluation.rows if row["controller"] == NO_VELOCITY and not row["success"]]
    lost = sum("held until release" in row["failure_reason"] for row in rows)
    return Finding(f"{lost} of {len(rows)} failures", at_least(proportion(lost, len(rows)), HALF))


def _limit_violations(evaluation: Evaluation, _at: object) -> Finding:
    def ended(row: Row) -> float:
        return float(not row["success"] and "held until release" not in row["failure_reason"])

    verdict, words = _lower(evaluation, _TO_NO_VELOCITY, ended, digits=2, counted=every, experiment=TABLE2)
    share = _each(lambda c: evaluation.mean(c, ended, counted=every), " %", 0, 100.0)
    return Finding(f"ended by a limit: {share}. Share, pairs: {words}", verdict, _why_grabs(evaluation))


def _jump(controller: Controller, when: Callable[[Row], float | None], what: str) -> Judge:
    def judge(evaluation: Evaluation, _at: object) -> Finding:
        rows = [row for row in evaluation.rows if row["controller"] == controller and went_on(row)]
        times = [at for row in rows if (at := when(row)) is not None]
        share = proportion(sum(abs(at) <= AT_ONCE_MS for at in times), len(times))
        order, words = _lower(evaluation, [(PROPOSED, controller)], "largest_step", unit=" N")
        steps = _each(lambda c: evaluation.mean(c, "largest_step"), " N")
        said = f"{steps}; at {what} in {shown(share, ' %', 0, 100.0)}. Pairs: {words}"
        return Finding(said, combined([order, at_least(share, MOST)]))

    return judge


def _after_detection_ms(row: Row) -> float | None:
    if row["detected_impact_time_s"] is None or row["largest_step_ms"] is None:
        return None
    return row["largest_step_ms"] - 1e3 * (row["detected_impact_time_s"] - row["nominal_impact_time_s"])


def _continuous(evaluation: Evaluation, _at: object) -> Finding:
    columns = ("step_to_interim", "step_to_post")
    less = (_scaled(column, NO_INTERIM, TENTH, "step_to_post") for column in columns)
    found = [evaluation.difference(PROPOSED, NO_INTERIM, own) for own in less]
    own_steps = [evaluation.mean(PROPOSED, column) for column in columns]
    words = f"{shown(own_steps[0])} and {shown(own_steps[1])} N from one tick to the next; no interim mode "
    words += f"{shown(evaluation.mean(NO_INTERIM, 'step_to_post'))}. Each less a tenth of that, pairs: "
    return Finding(words + "; ".join(shown(each) for each in found), combined(map(_below_zero, found)))


def _scaled(column: str, controller: Controller, factor: float, other: str | None = None) -> Value:
    """Return the value of a column, of one controller `factor` times it, or of another column."""

    def value(row: Row) -> float | None:
        if row["controller"] != controller:
            return row[column]
        number = row[other or column]
        return None if number is None else factor * number

    return value


def _minor_peak(evaluation: Evaluation, _at: object) -> Finding:
    def share(row: Row) -> float | None:
        return row["delay_peak"] / row["peak_in_window"] if row["delay_peak"] is not None else None

    ratio, delay = evaluation.mean(PROPOSED, share), evaluation.mean(PROPOSED, "detection_delay_ms")
    feedback = evaluation.mean(PROPOSED, "delay_peak_velocity_share")
    words = f"{shown(ratio, ' %', 1, 100.0)} of the highest, in the {shown(delay, ' ms')} to the detection"
    words += f"; {shown(feedback, ' %', 0, 100.0)} of it is velocity feedback"
    return Finding(words, at_most(ratio, TENTH))


def _repeatable(evaluation: Evaluation, _at: object) -> Finding:
    found = {}
    for column in ("average_force_norm", "peak_in_window"):
        groups: dict[object, list[float]] = defaultdict(list)
        for row in filter(went_on, evaluation.of(FIGURE11)):
            groups[row["controller"], row["reference"], place_of(row)].append(row[column])
        spread = [float(np.std(each, ddof=1) / np.mean(each)) for each in groups.values() if len(each) > 1]
        found[column] = plain_mean(spread)
    words = "standard deviation over mean: mean force norm {}, highest {}"
    said = words.format(*(shown(each, " %", 1, 100.0) for each in found.values()))
    return Finding(said, combined(at_most(each, TENTH) for each in found.values()))


def _small_peak(evaluation: Evaluation, _at: object) -> Finding:
    twice = _scaled("step_to_post", NO_VELOCITY, 1.0 / HALF)
    verdict, words = _lower(evaluation, [(NO_VELOCITY, NO_RS)], twice, unit=" N")
    at_switch = "; ".join(f"{NAMES[c].lower()} {shown(evaluation.mean(c, 'step_to_post'), ' N')}"
                          for c in (NO_VELOCITY, NO_RS))  # fmt: skip
    return Finding(f"at the switch: {at_switch}. Twice the first less the second: {words}", verdict)


def _settling_ms(row: Row) -> float | None:
    """Time to the end of slip; of a trial that has not ended by then or was lost before, UNSETTLED_MS."""
    if row["first_contact_s"] is None:
        return None
    return UNSETTLED_MS if row["settled_ms"] is None else row["settled_ms"]


def _settling(evaluation: Evaluation, _at: object) -> Finding:
    pairs = [*_TO_NO_VELOCITY, (NO_RS, NO_INTERIM), (NO_RS, PROPOSED)]
    verdict, words = _lower(evaluation, pairs, _settling_ms, unit=" ms", digits=0, counted=every)
    censored = {c: sum(row["settled_ms"] is None for row in evaluation.rows if row["controller"] == c) for c in NAMES}
    counts = ", ".join(f"{NAMES[c].lower()} {n}" for c, n in censored.items())
    each = _each(lambda c: evaluation.mean(c, _settling_ms, counted=every), " ms", 0)
    return Finding(f"{each}; not over in 0.5 s: {counts}. Pairs: {words}", verdict)


_TO_NO_VELOCITY = [(c, NO_VELOCITY) for c in NAMES if c is not NO_VELOCITY]
_BOTH = _against(PROPOSED, (NO_RS, NO_INTERIM))
_NOT_LOST = (
    "With no controller a pad is off for more than some ms: these pads vibrate on the object and slip, and do not "
    "bounce off it. What is dropped has slipped through (time to the end of slip)."
)
JUDGES: dict[str, Judge] = {
    "lowest_force_norm": lambda evaluation, at: _force_at(evaluation, at, _against(PROPOSED)),
    "high_at_zero": lambda evaluation, at: _force_at(evaluation, at, _BOTH),
    "fewest_grabs": lambda evaluation, _at: _grabs(evaluation, _against(NO_VELOCITY)),
    "most_grabs": lambda evaluation, _at: _grabs(evaluation, [(c, PROPOSED) for c in NAMES if c is not PROPOSED]),
    "lift_order": _lift_order,
    "dropped": _dropped,
    "limit_violations": _limit_violations,
    "jump_without_rs": _jump(NO_RS, lambda row: row["largest_step_ms"], "T_r"),
    "jump_without_interim": _jump(NO_INTERIM, _after_detection_ms, "the detection"),
    "continuous": _continuous,
    "minor_peak": _minor_peak,
    "repeatable": _repeatable,
    "small_peak": _small_peak,
    "peaks_reduced": _compared("peak_in_window", _against(PROPOSED)),
    "steps_reduced": _compared("largest_step", _against(PROPOSED), " N"),
    "swing": _compared("swing_m_s", _TO_NO_VELOCITY, " m/s", 3),
    "swing_other": _compared("swing_other_m_s", _TO_NO_VELOCITY, " m/s", 3),
    "contact_lost": _compared("lost_ms", _TO_NO_VELOCITY, " ms", why=_NOT_LOST),
    "other_robot": _compared("largest_step_other", _BOTH, " N"),
    "posture": _compared("posture_peak", _BOTH, " rad/s^2"),
    "settling": _settling,
}
