"""What the findings say: faults found, false alarms, time to the verdict, and which fault was taken for which."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from rtstack.campaign.statistics import Interval, proportion
from rtstack.studies.grab.cases import FURTHER, TRUE_KIND, FaultKind
from rtstack.studies.grab.worker import Finding

WANTED_FOUND, WANTED_FALSE = 0.99, 0.01  # the mark
NOTHING = "expected"


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
            "wrong": [finding.as_dict() for finding in self.wrong],
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
        delay = "-" if line.delay_ms is None else ", ".join(f"{x:.0f}" for x in line.delay_ms)
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


def page(summary: Summary, provenance: dict[str, Any], notes: str) -> str:
    """Return the report as a page of HTML. provenance: of the tuning; notes: which study, which digest."""
    said = sorted({kind for row in summary.confusion.values() for kind in row})
    head = "".join(f"<th>{escape(kind)}</th>" for kind in said)
    rows = "".join(
        f"<tr><th>{escape(true)}</th>" + "".join(f"<td>{row.get(kind, 0)}</td>" for kind in said) + "</tr>"
        for true, row in summary.confusion.items()
    )
    wrong = "".join(f"<li><code>{escape(json.dumps(finding.as_dict()))}</code></li>" for finding in summary.wrong)
    made = "".join(f"<li>{escape(str(name))}: {escape(str(value))}</li>" for name, value in provenance.items())
    mark = "reached" if summary.reached else "not reached"
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Aim-aware monitoring of the grab</title>
<style>body{{font:16px/1.5 sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}}
td,th{{padding:.2rem .6rem;border:1px solid #bbb;text-align:right}}table{{border-collapse:collapse}}</style>
<h1>Aim-aware monitoring of the grab</h1>
<p>{escape(notes)}</p>
<p>The mark (at least 99 % of faults found, at most 1 % false alarms) is <strong>{mark}</strong>.</p>
<pre>{escape(table(summary))}</pre>
<p>A verdict is right when the good are expected, and the faulty unexpected after what went wrong. Its time counts from
the first impact, for a push from its beginning, for an object that is missing from the nominal impact. kind: how often
the classification names the fault.</p>
<h2>What was taken for what</h2>
<table><tr><th>true, said</th>{head}</tr>{rows}</table>
<h2>Verdicts that are wrong</h2>
<ul>{wrong or "<li>none</li>"}</ul>
<h2>The tuning</h2>
<ul>{made}</ul>
</html>
"""
