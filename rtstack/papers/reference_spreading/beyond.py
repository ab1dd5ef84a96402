"""Beyond the paper: the contact-completion detector, its future work, against the proposed controller, pair by pair."""

from collections import defaultdict
from dataclasses import dataclass

from rtstack.experiments.claims import shown
from rtstack.experiments.experiment import Row
from rtstack.experiments.statistics import Interval, stratified_mean
from rtstack.papers.reference_spreading.controllers import Controller, millimetres, name_of
from rtstack.papers.reference_spreading.evaluation import FIGURE11, TABLE2, Evaluation, place_of

OURS, THEIRS = Controller.CONTACT_COMPLETION, Controller.PROPOSED
COMPARED = (THEIRS, OURS)
FORCE_NORM = "mean force norm"
MARGIN_MS = "margin_ms"  # a column of ours: see _margin_ms


@dataclass(frozen=True, slots=True)
class Comparison:
    """A line of the section: what is compared, both means, the paired difference (ours - theirs), and what it says."""

    what: str
    theirs: str
    ours: str
    difference: str
    verdict: str


def judge_beyond(evaluation: Evaluation) -> list[Comparison]:
    """Return every comparison for which there are trials of both. evaluation: of COMPARED, at least."""
    # Figure 11's repetitions where there are any: Table II has one of each
    rows = [row | {MARGIN_MS: _margin_ms(row)} for row in evaluation.of(FIGURE11) or evaluation.of(TABLE2)]
    displaced = [row for row in rows if row["displacement_mm"]]
    in_place = [row for row in rows if not row["displacement_mm"]]
    norms = {f"at {millimetres(d)}": evaluation.of(FIGURE11, displacement_mm=d) for d in evaluation.displacements()}
    lines = [
        _compared(f"{FORCE_NORM} {where}", some, "average_force_norm")
        for where, some in (norms or {"with the object displaced": displaced}).items()
    ]
    lines += [
        _compared(f"{what}, object displaced", displaced, column, unit, digits)
        for what, column, unit, digits in (
            ("highest force norm in the 200 ms", "peak_in_window", "", 1),
            ("highest force norm of the trial", "peak_force_norm", "", 1),
            ("largest change of the desired wrenches in a tick", "largest_step", " N", 2),
            ("change in the tick that ends the interim mode", "step_to_post", " N", 2),
            ("swing of the pad that is hit first", "swing_m_s", " m/s", 3),
            ("from full contact to the interim mode's end", MARGIN_MS, " ms", 1),
            ("duration of the interim mode", "interim_ms", " ms", 1),
        )
    ]
    lines.append(_compared("duration of the interim mode, object in place", in_place, "interim_ms", " ms"))
    found = [line for line in lines if line is not None]
    return [*found, _grabs(evaluation)] if found else []


def _margin_ms(row: Row) -> float | None:
    """How long after full contact the interim mode ended, ms: negative where it ended before."""
    needed = row["detected_impact_time_s"], row["interim_ms"], row["contact_completed_s"]
    if any(value is None for value in needed):
        return None
    return 1e3 * (row["detected_impact_time_s"] - row["contact_completed_s"]) + row["interim_ms"]


def _compared(what: str, rows: list[Row], column: str, unit: str = "", digits: int = 1) -> Comparison | None:
    both = _pairs([row for row in rows if row["success"]], column)
    if not both:
        return None
    means = [_mean({key: pair[controller] for key, pair in both.items()}) for controller in COMPARED]
    difference = _mean({key: pair[OURS] - pair[THEIRS] for key, pair in both.items()})
    theirs, ours = (shown(mean, unit, digits) for mean in means)
    return Comparison(what, theirs, ours, shown(difference, unit, digits), _verdict(difference, means[0]))


def _pairs(rows: list[Row], column: str) -> dict[tuple[object, ...], dict[str, float]]:
    """Return the values of each repetition by controller, where both have one; the repetition is the key's end."""
    pairs: dict[tuple[object, ...], dict[str, float]] = defaultdict(dict)
    for row in rows:
        if row[column] is not None:
            key = row["experiment"], row["reference"], place_of(row), row["repetition"]
            pairs[key][row["controller"]] = row[column]
    return {key: pair for key, pair in pairs.items() if len(pair) == len(COMPARED)}


def _mean(values: dict[tuple[object, ...], float]) -> Interval:
    """Mean and interval over the repetitions; with one of each, over references and displacements."""
    groups: dict[object, list[float]] = defaultdict(list)
    for (*of, _), value in values.items():
        groups[tuple(of)].append(value)
    if all(len(group) < 2 for group in groups.values()):
        groups = defaultdict(list, {None: list(values.values())})
    interval = stratified_mean(groups)
    assert interval is not None, "there is a pair"
    return interval


def _verdict(difference: Interval, theirs: Interval) -> str:
    """Say what a paired difference shows, and no more than that."""
    if difference.low is None or difference.high is None:
        return "cannot be told: one pair"
    share = f" by {100.0 * abs(difference.mean / theirs.mean):.0f} %" if theirs.mean > 0.0 else ""
    if difference.high < 0.0:
        return f"lower{share}"
    if difference.low > 0.0:
        return f"higher{share}"
    return "no difference that these trials can tell"


def _grabs(evaluation: Evaluation) -> Comparison:
    """Successful grabs, and in how many pairs one of both alone succeeded."""
    both = list(_pairs(evaluation.rows, "success").values())
    theirs, ours = (f"{sum(pair[c] > 0 for pair in both)} of {len(both)}" for c in COMPARED)
    lost = sum(pair[THEIRS] and not pair[OURS] for pair in both)
    won = sum(pair[OURS] and not pair[THEIRS] for pair in both)
    verdict = "no difference" if lost == won == 0 else "fewer" if lost > won else "more" if won > lost else "as many"
    return Comparison("successful grabs, all trials", theirs, ours, f"{won} won, {lost} lost", verdict)


def summary(lines: list[Comparison]) -> str:
    """Return the section's verdict in words: where the force norm is lower and where it is higher."""
    norms = [line for line in lines if line.what.startswith(FORCE_NORM)]
    name = name_of(OURS)
    parts = []
    for word in ("lower", "higher", "no difference", "cannot be told"):
        where = [line.what.removeprefix(FORCE_NORM).strip() for line in norms if line.verdict.startswith(word)]
        if where:
            parts.append(f"{word} {', '.join(where)}")
    return f"{name} against {name_of(THEIRS).lower()}, {FORCE_NORM}: {'; '.join(parts)}." if parts else ""
