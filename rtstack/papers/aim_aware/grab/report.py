"""What the findings say: faults found, false alarms, time to the verdict, and which fault was taken for which."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any

import numpy as np

from rtstack.experiments.claims import Claim, ClaimStatus, verdict_of
from rtstack.experiments.experiment import Results
from rtstack.experiments.page import PAGE
from rtstack.experiments.report import Figure, Report, Section
from rtstack.experiments.statistics import Interval, proportion
from rtstack.papers.aim_aware.grab.cases import FURTHER, TRUE_KIND, FaultKind
from rtstack.papers.aim_aware.grab.figures import figure_delays
from rtstack.papers.aim_aware.grab.worker import Finding
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
    delay_ms: tuple[float, float, float] | None
    classified: int


@dataclass(frozen=True, slots=True)
class Summary:
    """found: share of the mark's faults, false_alarms: share of good trials, both with a 95 % interval. confusion: what
    is true -> what was said -> how often, of further faults too."""

    found: Interval | None
    false_alarms: Interval | None
    lines: tuple[Line, ...]
    confusion: dict[str, dict[str, int]]
    wrong: tuple[Finding, ...]

    @property
    def reached(self) -> bool:
        """Whether the mark is reached."""
        found, alarms = self.found, self.false_alarms
        return found is not None and alarms is not None and found.mean >= WANTED_FOUND and alarms.mean <= WANTED_FALSE

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as JSON-ready values."""
        return {
            "found": _values(self.found),
            "false_alarms": _values(self.false_alarms),
            "reached": self.reached,
            "kinds": [
                {"name": x.name, "trials": x.trials, "right": x.right, "delay_ms": x.delay_ms, "named": x.classified}
                for x in self.lines
            ],
            "confusion": self.confusion,
            "wrong": [asdict(finding) for finding in self.wrong],
        }  # fmt: skip


def summarise(findings: Sequence[Finding]) -> Summary:
    """Return what the findings say."""
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


def _said(finding: Finding) -> str:
    return finding.kind or finding.verdict


def _line(fault: FaultKind | None, findings: Sequence[Finding]) -> Line:
    delays = [1e3 * f.delay_s for f in findings if f.right and f.delay_s is not None]
    spread = tuple(round(float(x), 1) for x in np.percentile(delays, (50, 95, 100))) if delays else None
    true = NOTHING if fault is None else TRUE_KIND[fault]
    return Line(
        "good" if fault is None else str(fault),
        len(findings),
        sum(finding.right for finding in findings),
        spread if spread is None else (spread[0], spread[1], spread[2]),
        sum(_said(finding) == true for finding in findings),
    )


def _values(interval: Interval | None) -> dict[str, float | None] | None:
    return None if interval is None else {"share": interval.mean, "low": interval.low, "high": interval.high}


def table(summary: Summary) -> str:
    """Return the summary as lines for a terminal."""
    lines = [f"{'':20}{'trials':>7}{'right':>7}{'kind':>6}  ms to the verdict: median, 95 %, largest"]
    for line in summary.lines:
        delay = "-" if line.delay_ms is None else ", ".join(f"{x:z.0f}" for x in line.delay_ms)
        lines.append(f"{line.name:20}{line.trials:7}{line.right:7}{line.classified:6}  {delay}")
    lines.append(f"faults found: {_share(summary.found)} (wanted: at least 99 %)")
    lines.append(f"false alarms: {_share(summary.false_alarms)} (wanted: at most 1 %)")
    return "\n".join(lines)


def _share(interval: Interval | None) -> str:
    if interval is None:
        return "nothing was run"
    if interval.low is None or interval.high is None:
        return f"{100.0 * interval.mean:.1f} %"
    return f"{100.0 * interval.mean:.1f} %, 95 % interval {100.0 * interval.low:.1f} to {100.0 * interval.high:.1f} %"


def report(tunings: Mapping[str, Mapping[str, Any]], results: Results) -> Report:
    """Return the report, a part for each object. tunings: object -> provenance; the mark is that of the first one."""
    names = [field.name for field in fields(Finding)]
    findings = [Finding(**{name: row[name] for name in names}) for row in results.rows]
    summaries = {name: summarise([f for f in findings if f.object == name]) for name in tunings}
    parts = [Section(name, _claims(summary), numbers=summary.as_dict()) for name, summary in summaries.items()]
    draw = partial(figure_delays, findings=findings, objects=list(tunings))
    return Report(
        parts, [Figure("delays.png", CAPTION, draw)], page=("rtstack.papers.aim_aware.grab", PAGE),
        summary="\n\n".join(f"{name}\n{table(summary)}" for name, summary in summaries.items()),
        reached=next(iter(summaries.values())).reached,
        values={
            "summaries": summaries, "tunings": tunings, "share": _share, "wanted": (WANTED_FOUND, WANTED_FALSE),
            "columns": [NOTHING, "none", *map(str, Unexpected)],
        },
    )  # fmt: skip


def _claims(summary: Summary) -> list[Claim]:
    found, alarms = summary.found, summary.false_alarms
    unknown = ClaimStatus.UNDECIDED
    return [
        Claim("mark", f"at least {100.0 * WANTED_FOUND:g} % of the faults are found", _share(found),
              unknown if found is None else verdict_of(found.mean >= WANTED_FOUND), _missed(summary)),
        Claim("mark", f"at most {100.0 * WANTED_FALSE:g} % of the good grabs are false alarms", _share(alarms),
              unknown if alarms is None else verdict_of(alarms.mean <= WANTED_FALSE)),
    ]  # fmt: skip


def _missed(summary: Summary) -> str:
    """Say which faults of the mark were not found, and whether the grab succeeded all the same."""
    missed = [finding for finding in summary.wrong if finding.fault is not None and finding.fault not in FURTHER]
    grabs = "; ".join(f"{each.fault}, a grab that {'succeeded' if each.success else 'failed'}" for each in missed)
    return f"Not found: {grabs}." if missed else ""
