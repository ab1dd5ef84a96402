"""The judges of the paper's claims, which its plan has in words: what a campaign says about each.

They judge the numbers that the paper prints: Table II, Figure 11, and what is behind them.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rtstack.experiments.claims import Claim, ClaimStatus, at_least, at_most, combined, shown
from rtstack.experiments.experiment import Row
from rtstack.experiments.registration import Finding, Judge, PlannedClaim, judged
from rtstack.experiments.statistics import Interval, plain_mean, proportion, stratified_mean
from rtstack.papers.reference_spreading.controllers import NAMES, Controller

TABLE2, FIGURE11 = "table2", "figure11"
NOMINAL = "nominal"
RICE_BOX = "rice_box"
NO_RS, NO_VELOCITY, NO_INTERIM, PROPOSED = (
    Controller.NO_REFERENCE_SPREADING, Controller.NO_VELOCITY_FEEDBACK, Controller.NO_INTERIM, Controller.PROPOSED,
)  # fmt: skip
# what the marks of the plans say in words
TENTH, HALF, MOST = 0.1, 0.5, 0.9
AT_ONCE_MS = 2.0
UNSETTLED_MS = 500.0  # a time that is not over by then counts as this

ControllerValue = Callable[[Controller], Interval | None]


@dataclass(frozen=True, slots=True)
class Table2Line:
    """One controller: share of successful grabs; lift over its reference's and displacement's mean, mm, in Table II's
    trials and (repeated) of Figure 11's rice boxes.
    """

    controller: Controller
    success: Interval | None
    lift_mm: Interval | None
    repeated_lift_mm: Interval | None


AFTER_S = 0.3  # see went_on

Value = Callable[[Row], float | None]
Counted = Callable[[Row], bool]

# Table II of the paper: successful grabs, %, and average maximum lifting height difference, mm
PAPER_TABLE2 = {
    Controller.NO_REFERENCE_SPREADING: (80.0, 9.81),
    Controller.NO_VELOCITY_FEEDBACK: (40.0, -17.07),
    Controller.NO_INTERIM: (85.0, 0.78),
    Controller.PROPOSED: (90.0, 6.47),
}


class Evaluation:
    """The results of a campaign under some conditions. controllers: by default the paper's four."""

    def __init__(
        self, rows: list[Row], conditions: str = NOMINAL, controllers: Iterable[str] = tuple(PAPER_TABLE2)
    ) -> None:
        wanted = set(controllers)
        self.rows = [row for row in rows if row["conditions"] == conditions and row["controller"] in wanted]
        self.conditions = conditions

    def of(self, experiment: str, **values: object) -> list[Row]:
        return [
            row
            for row in self.rows
            if row["experiment"] == experiment and all(row[name] == value for name, value in values.items())
        ]

    def displacements(self) -> list[float]:
        return sorted({row["displacement_mm"] for row in self.of(FIGURE11)})

    def table2(self) -> list[Table2Line]:
        """Return Table II: of its own trials, and the lift as the paper takes it, of Figure 11's rice boxes."""
        own, repeated = self.of(TABLE2), self.of(FIGURE11, object=RICE_BOX)
        lines = []
        for controller in PAPER_TABLE2:
            rows = [row for row in own if row["controller"] == controller]
            success = proportion(sum(row["success"] for row in rows), len(rows))
            lines.append(Table2Line(controller, success, _lift(own, controller), _lift(repeated, controller)))
        return lines

    def mean_force(
        self, controller: Controller, displacement_mm: float, name: str = "average_force_norm",
        experiment: str = FIGURE11,
    ) -> Interval | None:  # fmt: skip
        """Return a point of Figure 11: the mean of (33), or of another column, of trials that `went_on`."""
        groups: dict[object, list[float]] = defaultdict(list)
        for row in self.of(experiment, controller=controller, displacement_mm=displacement_mm):
            if went_on(row) and row[name] is not None:
                groups[row["reference"]].append(row[name])
        return stratified_mean(groups)

    def mean(self, controller: Controller, value: str | Value, *, counted: Counted | None = None) -> Interval | None:
        """Return the mean over references of a column or function, with its t interval. counted: default `went_on`."""
        groups: dict[str, list[float]] = defaultdict(list)
        for row in self.rows:
            if row["controller"] == controller and (counted or went_on)(row):
                _gather(groups[row["reference"]], row, value)
        return plain_mean(sum(group) / len(group) for group in groups.values() if group)

    def difference(
        self, first: Controller, second: Controller, value: str | Value, *, counted: Counted | None = None,
        **wanted: object,
    ) -> Interval | None:  # fmt: skip
        """Return the mean of `first` less `second`, pair by pair, with its t interval over the references' means.

        A pair has the same experiment, reference, place and repetition, and so the same seed. counted: which trials, of
        both; by default those that `went_on`. wanted: values of columns, such as displacement_mm=30.0.
        """
        pairs: dict[tuple[object, ...], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
        for row in self.rows:
            if (counted or went_on)(row) and all(row[name] == each for name, each in wanted.items()):
                key = row["reference"], row["experiment"], place_of(row), row["repetition"]
                _gather(pairs[key][row["controller"]], row, value)
        groups: dict[object, list[float]] = defaultdict(list)
        for (reference, *_), by in pairs.items():
            if by[first] and by[second]:
                groups[reference].append(by[first][0] - by[second][0])
        return plain_mean(sum(group) / len(group) for group in groups.values())

    def failures(self) -> dict[str, dict[str, int]]:
        """Return how often each reason ended a trial, by controller."""
        counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
        for row in self.rows:
            if not row["success"]:
                counts[kind_of(row["failure_reason"])][row["controller"]] += 1
        return {reason: dict(by) for reason, by in sorted(counts.items())}


def went_on(row: Row) -> bool:
    """Whether a trial went on for AFTER_S beyond its nominal impact: all of what the measures of the impact look at.

    An object that is dropped later changes none of them, and to leave such a trial out would leave out the worst ones.
    """
    return row["ticks"] is not None and 1e-3 * row["ticks"] >= row["nominal_impact_time_s"] + AFTER_S


def every(row: Row) -> bool:
    return True


def _gather(into: list[float], row: Row, value: str | Value) -> None:
    number = row[value] if isinstance(value, str) else value(row)
    if number is not None:
        into.append(float(number))


def place_of(row: Row) -> tuple[float, ...]:
    """Return where the object was put: mm along y and x, degrees about z; a row of before knows of y alone."""
    return row["displacement_mm"], row.get("displacement_x_mm", 0.0), row.get("yaw_deg", 0.0)


def kind_of(reason: str) -> str:
    """Return a failure without its numbers, so that equal ones count together."""
    return ": ".join(reason.split(" (")[0].split(": ")[:3])


def _lift(rows: list[Row], controller: Controller) -> Interval | None:
    """Mean of the lift's difference to the mean of its reference and displacement, of successful trials only."""
    heights: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row["success"] and row["max_lift_mm"] is not None:
            heights[row["reference"], place_of(row)].append(row["max_lift_mm"])
    groups: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row["success"] and row["controller"] == controller and row["max_lift_mm"] is not None:
            same = heights[row["reference"], place_of(row)]
            groups[row["reference"]].append(row["max_lift_mm"] - sum(same) / len(same))
    return plain_mean(sum(group) / len(group) for group in groups.values())


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
