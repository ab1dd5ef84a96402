"""Report of the grab's monitor: faults found, false alarms, time to the verdict and the confusion of faults."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from rtstack.experiments.claims import ClaimStatus, at_least, at_most
from rtstack.experiments.experiment import Results
from rtstack.experiments.registration import Finding, Judge, PlannedClaim, judged
from rtstack.experiments.report import PAGE, Figure, Report, Section
from rtstack.experiments.statistics import Interval, proportion
from rtstack.figures.style import STYLE, new_figure, save
from rtstack.papers.aim_aware.grab.cases import FURTHER, TRUE_KIND, FaultKind
from rtstack.papers.aim_aware.grab.worker import GrabOutcome
from rtstack.trials.unexpected import Unexpected

WANTED_FOUND, WANTED_FALSE = 0.99, 0.01  # the mark
NOTHING = "expected"
CAPTION = (
    "Time from what goes wrong, or from the first impact, to the verdict; every trial whose verdict is right is a dot. "
    "A good grab is expected once the object was carried for half a second."
)


@dataclass(frozen=True, slots=True)
class Line:
    """One kind of trial: how many, how many verdicts are right, and ms to the verdict (median, 95 %, largest)."""

    name: str
    trials: int
    right: int
    delay_ms: tuple[float, ...] | None
    named: int


@dataclass(frozen=True, slots=True)
class Summary:
    """found: share of the mark's faults, false_alarms: of good trials. confusion: what is true -> what was said ->
    count."""

    found: Interval | None
    false_alarms: Interval | None
    lines: tuple[Line, ...]
    confusion: dict[str, dict[str, int]]
    wrong: tuple[GrabOutcome, ...]

    @property
    def reached(self) -> bool:
        """True if the mean shares reach the marks."""
        found, alarms = self.found, self.false_alarms
        return found is not None and alarms is not None and found.mean >= WANTED_FOUND and alarms.mean <= WANTED_FALSE

    def as_dict(self) -> dict[str, Any]:
        return {
            "found": _values(self.found), "false_alarms": _values(self.false_alarms), "reached": self.reached,
            "kinds": [asdict(line) for line in self.lines], "confusion": self.confusion,
            "wrong": [asdict(finding) for finding in self.wrong],
        }  # fmt: skip


def summarise(findings: Sequence[GrabOutcome]) -> Summary:
    faulty = [finding for finding in findings if finding.fault is not None and finding.fault not in FURTHER]
    good = [finding for finding in findings if finding.fault is None]
    confusion: dict[str, Counter[str]] = {}
    for finding in findings:
        true = str(TRUE_KIND[FaultKind(finding.fault)]) if finding.fault is not None else NOTHING
        confusion.setdefault(true, Counter())[_said(finding)] += 1
    return Summary(
        found=proportion(sum(finding.right for finding in faulty), len(faulty)),
        false_alarms=proportion(sum(not finding.right for finding in good), len(good)),
        lines=tuple(_line(name, [f for f in findings if f.fault == name]) for name in (None, *FaultKind)),
        confusion={true: dict(said) for true, said in confusion.items()},
        wrong=tuple(finding for finding in findings if not finding.right),
    )


def _said(finding: GrabOutcome) -> str:
    return finding.kind or finding.verdict


def _line(fault: FaultKind | None, findings: Sequence[GrabOutcome]) -> Line:
    delays = [1e3 * f.delay_s for f in findings if f.right and f.delay_s is not None]
    spread = tuple(round(float(x), 1) for x in np.percentile(delays, (50, 95, 100))) if delays else None
    true = NOTHING if fault is None else TRUE_KIND[fault]
    right, named = sum(f.right for f in findings), sum(_said(f) == true for f in findings)
    return Line("good" if fault is None else str(fault), len(findings), right, spread, named)


def _values(interval: Interval | None) -> dict[str, float | None] | None:
    return None if interval is None else {"share": interval.mean, "low": interval.low, "high": interval.high}


def _share(interval: Interval | None) -> str:
    if interval is None:
        return "nothing was run"
    if interval.low is None or interval.high is None:
        return f"{100.0 * interval.mean:.1f} %"
    return f"{100.0 * interval.mean:.1f} %, 95 % interval {100.0 * interval.low:.1f} to {100.0 * interval.high:.1f} %"


def report(tunings: Mapping[str, Mapping[str, Any]], results: Results, claims: Sequence[PlannedClaim] = ()) -> Report:
    """Return the report, a part for each object. tunings: object -> provenance; the mark is of the first one."""
    names = [field.name for field in fields(GrabOutcome)]
    findings = [GrabOutcome(**{name: row[name] for name in names}) for row in results.rows]
    summaries = {name: summarise([f for f in findings if f.object == name]) for name in tunings}
    parts = [Section(name, judged(claims, JUDGES, each), numbers=each.as_dict()) for name, each in summaries.items()]
    draw = partial(figure_delays, findings=findings, objects=list(tunings))
    return Report(
        parts, [Figure("delays.png", CAPTION, draw)], page=("rtstack.papers.aim_aware.grab", PAGE),
        summary="\n".join(
            f"{name}: faults found: {_share(each.found)}; false alarms: {_share(each.false_alarms)}"
            for name, each in summaries.items()
        ),
        reached=next(iter(summaries.values())).reached,
        values={
            "summaries": summaries, "tunings": tunings, "share": _share, "wanted": (WANTED_FOUND, WANTED_FALSE),
            "columns": [NOTHING, "none", *map(str, Unexpected)],
        },
    )  # fmt: skip


def _finding(share: Interval | None, verdict: ClaimStatus, why: str = "") -> Finding:
    """Return the finding of a share; UNDECIDED for fewer than two trials."""
    return Finding(_share(share), verdict if share is not None and share.n > 1 else ClaimStatus.UNDECIDED, why)


JUDGES: dict[str, Judge] = {
    "faults found": lambda summary, at: _finding(
        summary.found, at_least(summary.found, WANTED_FOUND), _missed(summary)
    ),
    "false alarms": lambda summary, at: _finding(summary.false_alarms, at_most(summary.false_alarms, WANTED_FALSE)),
}


def _missed(summary: Summary) -> str:
    """Return the faults of the mark that were not found, and whether the grab succeeded."""
    missed = [finding for finding in summary.wrong if finding.fault is not None and finding.fault not in FURTHER]
    grabs = "; ".join(f"{each.fault}, a grab that {'succeeded' if each.success else 'failed'}" for each in missed)
    return f"Not found: {grabs}." if missed else ""


COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00")  # Okabe and Ito's, one an object
HEIGHT = 0.6  # of an object's share of a row, in which its dots are spread


@mpl.rc_context(STYLE)
def figure_delays(path: Path, findings: Sequence[GrabOutcome], objects: Sequence[str]) -> None:
    """Draw the time to the verdict, a row a kind of trial, a colour an object, with the medians."""
    kinds = (None, *FaultKind)
    figure, axes = new_figure(7.5, 0.6 + 0.5 * len(kinds))
    axis = axes[0, 0]
    share = 1.0 / len(objects)
    for number, name in enumerate(objects):
        colour = COLOURS[number % len(COLOURS)]
        axis.plot([], [], "o", color=colour, markersize=4, label=name.replace("_", " "))
        for row, kind in enumerate(kinds):
            right = [f for f in findings if f.object == name and f.fault == kind and f.right]
            delays = [1e3 * f.delay_s for f in right if f.delay_s is not None]
            if not delays:
                continue
            middle = row - 0.5 + (number + 0.5) * share
            spread = middle + HEIGHT * share * (np.modf(np.arange(len(delays)) * 0.618)[0] - 0.5)
            axis.plot(delays, spread, "o", color=colour, markersize=3, alpha=0.6, markeredgewidth=0, zorder=3)
            axis.plot([np.median(delays)] * 2, middle + np.array([-0.5, 0.5]) * share, color="black", linewidth=1.0)
    axis.set_yticks(range(len(kinds)), ["good", *map(str, FaultKind)])
    axis.set_ylim(len(kinds) - 0.5, -0.5)
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("ms to the verdict (bar: median)")
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(objects))
    save(figure, path)
