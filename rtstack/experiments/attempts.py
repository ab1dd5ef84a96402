"""What a campaign on arms has done, attempt by attempt: preparations, cases, placements, waits for a person."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads its functions when they are used

from hal.robot_errors import ROBOT_ERRORS
from rtstack.experiments.report import Figure, Table
from rtstack.experiments.statistics import CONFIDENCE
from rtstack.loop.end import OUTSIDE, End
from rtstack.trials.run import ON_THE_WAY

# A run that ended so counts for no controller: a person, a watchdog, this host or the link has ended it.
ABORTS = OUTSIDE | {End.HARDWARE, End.TICK_OVERRUN, End.TORQUE_NOT_TAKEN, End.NOT_AT_REST}

LINK_ERROR = "communication_constraints_violation"  # the robot's, where answers did not come in time


class Kind(StrEnum):
    START = "to the start"
    PREPARATION = "preparation"
    CASE = "case"
    CONTROL = "control case"
    WARM_UP = "warm-up"
    PLACEMENT = "placement"
    PUT_DOWN = "put down"
    PERSON = "waiting for a person"
    REST = "rest"


@dataclass(frozen=True, slots=True)
class Attempt:
    """One of them.

    began: UTC; case_id: of the case, or the name of the stage's task, that it was for; failed: why, None for a success;
    counts: whether a case has its row from it. off_mm, off_deg: where the object stands after a placement, from where
    it was wanted; peak_force_n: on a pad meanwhile. row: of a control case, as JSON.
    """

    began: str
    kind: str
    case_id: str
    failed: str | None
    counts: bool
    duration_s: float
    off_mm: float | None = None
    off_deg: float | None = None
    peak_force_n: float | None = None
    log: str | None = None
    row: str | None = None


def aborted(reason: str | None) -> bool:
    """Return whether a run ended for a reason that counts for no controller. reason: why it failed, None for success.

    A reflex is what the controller has led the robot to, and counts; a lost link and the way to the start do not.
    """
    return ON_THE_WAY in str(reason) or (End.in_reason(reason) in ABORTS and not reflex(reason))


def reflex(reason: str | None) -> bool:
    """Return whether the reason names an error of the robot's that is not of its link."""
    named = [name for name in ROBOT_ERRORS if End.in_reason(reason) is End.HARDWARE and name in str(reason)]
    return bool(named) and LINK_ERROR not in named


def tables(attempts: Sequence[Attempt], drift: Sequence[str]) -> list[Table]:
    """Return what was attempted and why it failed, the times of a case, placements, and the control cases' drift."""
    found = [_outcomes(attempts), _times(attempts)]
    placements = [each for each in attempts if each.kind == Kind.PLACEMENT]
    if placements:
        found.append(_placements(placements))
    controls = _controls(attempts)
    if len(controls) > 2 and drift:
        found.append(_drift(controls, drift))
    return found


def figures(attempts: Sequence[Attempt], drift: Sequence[str]) -> list[Figure]:
    controls = _controls(attempts)
    if not controls or not drift:
        return []

    def draw(path: Path) -> None:
        from rtstack.figures.style import new_figure, save

        figure, axes = new_figure(7.0, 1.8 * len(drift), nrows=len(drift), sharex=True)
        for axis, name in zip(axes[:, 0], drift, strict=True):
            points = np.array([(k, row[name]) for k, row in controls if row.get(name) is not None]).reshape(-1, 2)
            axis.plot(points[:, 0], points[:, 1], "o-", markersize=3)
            axis.set_ylabel(name)
        axes[-1, 0].set_xlabel("cases run before")
        save(figure, path)

    return [Figure("drift.png", "The control case, repeated over the campaign.", draw)]


def _outcomes(attempts: Iterable[Attempt]) -> Table:
    counted = Counter((each.kind, "yes" if each.counts else "no", each.failed or "-") for each in attempts)
    lines = [(*key, str(number)) for key, number in sorted(counted.items(), key=lambda item: (item[0][0], -item[1]))]
    return Table("Attempts on the arms", ("what", "has a row", "why it failed", "number"), lines, numbers_from=3)


def _times(attempts: Sequence[Attempt]) -> Table:
    total_s = sum(each.duration_s for each in attempts) or 1.0
    lines = []
    for kind in Kind:
        if taken_s := [each.duration_s for each in attempts if each.kind == kind]:
            p50, p95 = np.percentile(taken_s, (50, 95))
            share = 100.0 * sum(taken_s) / total_s
            lines.append((str(kind), str(len(taken_s)), f"{p50:.1f}", f"{p95:.1f}", f"{share:.0f}"))
    headings = ("what", "number", "median, s", "95th percentile, s", "share of the time, %")
    return Table("Where the time went", headings, lines)


def _placements(placements: Sequence[Attempt]) -> Table:
    lines = []
    for name, unit in (("off_mm", "mm"), ("off_deg", "degrees"), ("peak_force_n", "N")):
        values = [value for each in placements if (value := getattr(each, name)) is not None]
        if values:
            p50, p95 = np.percentile(values, (50, 95))
            lines.append((f"{name.removesuffix(f'_{unit}')}, {unit}", f"{p50:.2f}", f"{p95:.2f}", f"{max(values):.2f}"))
    failed = sum(each.failed is not None for each in placements)
    note = f"{len(placements)} placements, {failed} not near enough at once. By the tracker, from the wanted place."
    return Table("Placements of the object by the arms", ("", "median", "95th percentile", "largest"), lines, note)


def _controls(attempts: Iterable[Attempt]) -> list[tuple[int, dict[str, Any]]]:
    """Return of each control case how many cases had run before it, and its row."""
    found, before = [], 0
    for each in attempts:
        before += each.kind == Kind.CASE and each.counts
        if each.kind == Kind.CONTROL and each.row is not None:
            found.append((before, json.loads(each.row)))
    return found


def _drift(controls: Sequence[tuple[int, dict[str, Any]]], drift: Sequence[str]) -> Table:
    lines = []
    for name in drift:
        points = [(k, float(row[name])) for k, row in controls if row.get(name) is not None]
        if len(points) < 3:
            continue
        x, y = np.array(points).T
        (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
        half = float(scipy.special.stdtrit(len(points) - 2, 0.5 + CONFIDENCE / 2)) * float(np.sqrt(covariance[0, 0]))
        per_100 = f"{100 * slope:.3g} [{100 * (slope - half):.3g}, {100 * (slope + half):.3g}]"
        lines.append((name, str(len(points)), f"{y.mean():.4g}", per_100))
    headings = ("column", "runs", "mean", "change in 100 cases [95 %]")
    return Table("Drift of the control case", headings, lines, "A line through the runs of the control case.")
