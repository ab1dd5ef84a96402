"""The judges of the paper's claims, which its plan has in words: what a campaign says about each."""

from collections.abc import Callable, Sequence

import numpy as np

from rtstack.experiments.claims import Claim, ClaimStatus, at_least, at_most, combined, order, shown, verdict_of
from rtstack.experiments.registration import Finding, Judge, PlannedClaim, judged
from rtstack.experiments.statistics import Interval, plain_mean
from rtstack.impact_map import ReflectedInertia
from rtstack.papers.impact_maps import evaluation
from rtstack.papers.impact_maps.evaluation import NAMES, Table
from rtstack.papers.impact_maps.prediction import MapKind
from rtstack.references.motion import Motion

B_THETA, B, NONE = ReflectedInertia.B_THETA, ReflectedInertia.B, ReflectedInertia.NONE
SINGLE, CONVERGED = MapKind.SINGLE_STEP, MapKind.CONVERGED
LARGEST_ERROR = 4.0  # %, absolute, with B_theta
LEAST_R_SQUARED = 0.98


def judge_claims(claims: Sequence[PlannedClaim], under: Sequence[Table]) -> list[Claim]:
    """Return the plan's claims under one set of conditions, without those about a table that is not there."""
    there = {str(table.motion) for table in under}
    some = [claim for claim in claims if (claim.at in there if claim.at is not None else len(there) == len(Motion))]
    return judged(some, JUDGES, under)


def _of_table(judge: Callable[[Table], Finding]) -> Judge:
    return lambda under, at: judge(next(table for table in under if table.motion == at))


def _percent(interval: Interval | None) -> str:
    return shown(interval, " %", 2)


def _small(table: Table) -> Finding:
    error = table.absolute((SINGLE, B_THETA))
    ours = f"{_percent(error)}; converged map {_percent(table.absolute((CONVERGED, B_THETA)))}"
    return Finding(ours, at_most(error, LARGEST_ERROR), _why_single(table))


def _why_single(table: Table) -> str:
    """Why a single step is off: by how much it is below the converged map, which the estimates follow or not."""
    below = [
        100.0 * (cell.predicted[SINGLE, B_THETA] / cell.predicted[CONVERGED, B_THETA] - 1.0) for cell in table.cells
    ]
    if not below or max(map(abs, below)) < 0.1:
        return "Both maps agree here."
    nearer = table.over_robots(
        lambda robot: float(np.mean([abs(c) < abs(s) for s, c in zip(
            table.errors((SINGLE, B_THETA), robot), table.errors((CONVERGED, B_THETA), robot), strict=True)]))
    )  # fmt: skip
    return (
        f"A single step is {-max(below):.1f} to {-min(below):.1f} % below the converged map: it leaves corners of the "
        "pads opening, and the object slower than the pads. The squeeze closes the corners again, and the sequence "
        "ends in the converged map's velocity (docs/impact_map.md, tests/programs/impact_sequence.py). The converged "
        f"map is nearer to the estimate in {shown(nearer, ' %', 0, 100.0)} of the lines. A reference by the single "
        "step moves the pads apart, which moves the estimate by itself (tests/programs/impact_references.py)."
    )


def _lower(first: ReflectedInertia, second: ReflectedInertia) -> Judge:
    def judge(table: Table) -> Finding:
        difference = table.less((SINGLE, first), (SINGLE, second))
        ours = "; ".join(f"{NAMES[kind]} {_percent(table.absolute((SINGLE, kind)))}" for kind in NAMES)
        ours += f". {NAMES[first]} less {NAMES[second]}: {_percent(difference)}; converged map: "
        ours += _percent(table.less((CONVERGED, first), (CONVERGED, second)))
        return Finding(ours, at_most(difference, 0.0), _apart(table, first, second))

    return _of_table(judge)


def _apart(table: Table, first: ReflectedInertia, second: ReflectedInertia) -> str:
    apart = [100.0 * abs(cell.predicted[SINGLE, second] / cell.predicted[SINGLE, first] - 1.0) for cell in table.cells]
    if not apart:
        return ""
    return f"The two predictions are {np.mean(apart):.2f} % apart on average, {max(apart):.2f} % at most."


def _bias(kind: ReflectedInertia, above: bool) -> Judge:
    def judge(table: Table) -> Finding:
        average = table.average((SINGLE, kind))
        verdict = at_least(average, 0.0) if above else at_most(average, 0.0)
        return Finding(f"{_percent(average)}; converged map {_percent(table.average((CONVERGED, kind)))}", verdict)

    return _of_table(judge)


def _over_in_every_line(table: Table) -> Finding:
    errors = [error for robot in table.robots for error in table.errors((SINGLE, B), robot)]
    over = sum(error > 0.0 for error in errors)
    said = f"in {over} of {len(errors)} (lines times robots)"
    return Finding(said, verdict_of(over == len(errors)) if errors else ClaimStatus.UNDECIDED)


def _straight(table: Table) -> Finding:
    worst = table.r_squared
    if worst is None:
        return Finding("-", ClaimStatus.UNDECIDED)
    why = "Friction that scatters from trial to trial holds what (29) integrates, the more the heavier the object."
    return Finding(f"at least {worst:.4f}", verdict_of(worst >= LEAST_R_SQUARED), why)


def _configuration(table: Table) -> Finding:
    """Estimate of case 3 less that of case 1 of the heaviest object, robot by robot."""
    cells = {(cell.object, cell.case): cell for cell in table.cells}
    heaviest = max((thing for thing, _ in cells), default="")
    first, third = cells.get((heaviest, "1")), cells.get((heaviest, "3"))
    if first is None or third is None:
        return Finding("-", ClaimStatus.UNDECIDED)
    both = sorted(set(first.fits) & set(third.fits))
    change = plain_mean(third.fits[robot].estimate - first.fits[robot].estimate for robot in both)
    words = f"{heaviest.replace('_', ' ')}: {shown(change, ' m/s', 4)}"
    if first.fit is not None and third.fit is not None:
        words += f", from {first.fit.estimate:.3f} to {third.fit.estimate:.3f} m/s"
    apart = [third.predicted[kind, B_THETA] - first.predicted[kind, B_THETA] for kind in (SINGLE, CONVERGED)]
    words += f"; predicted {apart[0]:+.4f}, converged map {apart[1]:+.4f}"
    changes = ClaimStatus.HOLDS in (at_least(change, 0.0), at_most(change, 0.0))
    return Finding(words, ClaimStatus.HOLDS if changes else ClaimStatus.UNDECIDED)


def _best_and_worst(under: Sequence[Table], _at: object) -> Finding:
    def said(which: MapKind) -> str:
        return "; ".join(f"{NAMES[kind]} {_percent(evaluation.combined(under, (which, kind)))}" for kind in NAMES)

    pairs = [((SINGLE, B_THETA), (SINGLE, NONE)), ((SINGLE, NONE), (SINGLE, B))]
    verdict = combined(at_most(evaluation.combined(under, a, b), 0.0) for a, b in pairs)
    grab = next((table for table in under if table.motion is Motion.GRAB), None)
    return Finding(f"{said(SINGLE)}. Converged map: {said(CONVERGED)}", verdict, _why_single(grab) if grab else "")


def _swings_more(under: Sequence[Table], _at: object) -> Finding:
    swing = {
        table.motion: plain_mean(s for cell in table.cells if (s := cell.swing_percent) is not None) for table in under
    }
    words = "; ".join(f"{motion} {_percent(swing[motion])}" for motion in Motion)
    return Finding(words, order([(swing[Motion.HIT_AND_PUSH], swing[Motion.GRAB])]))


def _drops(table: Table) -> Finding:
    drop = table.over_robots(lambda robot: float(np.mean([cell.drop[robot] for cell in table.cells if cell.fits])))
    return Finding(f"{_percent(drop)} of the prediction", at_most(drop, 0.0))


def _converged_is_nearer(table: Table) -> Finding:
    return Finding(
        f"single step {_percent(table.absolute((SINGLE, B_THETA)))}, converged "
        f"{_percent(table.absolute((CONVERGED, B_THETA)))}",
        at_most(table.less((CONVERGED, B_THETA), (SINGLE, B_THETA)), 0.0),
    )


JUDGES: dict[str, Judge] = {
    "small_error": _of_table(_small), "straight": _of_table(_straight), "drops": _of_table(_drops),
    "configuration": _of_table(_configuration), "converged_is_nearer": _of_table(_converged_is_nearer),
    "better_than_B": _lower(B_THETA, B), "better_than_none": _lower(B_THETA, NONE),
    "none_as_good": _lower(NONE, B_THETA), "overestimates": _bias(B_THETA, above=True),
    "none_underestimates": _bias(NONE, above=False), "B_overestimates": _bias(B, above=True),
    "B_over_in_every_line": _of_table(_over_in_every_line), "best_and_worst": _best_and_worst,
    "swings_more": _swings_more,
}  # fmt: skip
