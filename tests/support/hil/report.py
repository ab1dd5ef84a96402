"""The report that is kept of a run of the suite: what was where, and what each number came to."""

import platform
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from rtstack.check.host import host_findings
from rtstack.trials.provenance import git_commit, package_versions

_VERDICTS = {"passed": "pass", "failed": "FAIL", "skipped": "not run"}


@dataclass(frozen=True, slots=True)
class Entry:
    """A number: file and test as pytest names them, verdict, figures by name, and why where it did not pass."""

    number: str
    name: str
    verdict: str
    figures: tuple[tuple[str, Any], ...]
    reason: str

    @classmethod
    def of(cls, report: pytest.TestReport) -> "Entry":
        """Return what a report says."""
        file, _, test = report.nodeid.rpartition("/")[2].partition("::")
        reason = ""
        if report.skipped and isinstance(report.longrepr, tuple):
            reason = report.longrepr[2].removeprefix("Skipped: ")
        elif report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            reason = str(crash.message if crash else report.longrepr).splitlines()[0]
        name = test.removeprefix("test_").replace("_", " ")
        return cls(file[5:7], name, _VERDICTS[report.outcome], tuple(report.user_properties), reason)


def write_report(path: Path, cell: str | None, entries: list[Entry]) -> None:
    """Write the report as Markdown. cell: the addresses, None for the simulated cell of the suite's own."""
    versions = ", ".join(f"{name} {version}" for name, version in package_versions().items())
    lines = [
        "# Hardware in the loop",
        "",
        f"- date: {datetime.now().astimezone().isoformat(timespec='seconds')}",
        f"- arms: {cell or 'simulated, in lockstep (no address was given)'}",
        f"- host: {platform.node()}, {platform.release()}; "
        + "; ".join(f"{finding.name} {finding.value} ({finding.verdict})" for finding in host_findings()),
        f"- versions: {versions}",
        f"- commit: {git_commit()}",
        "",
        "| number | what | verdict | figures |",
        "|---|---|---|---|",
    ]
    for entry in entries:
        figures = ", ".join(f"{name} {_shown(value)}" for name, value in entry.figures)
        said = "; ".join(text for text in (figures, entry.reason) if text).replace("|", "/")
        lines.append(f"| {entry.number} | {entry.name} | {entry.verdict} | {said or '-'} |")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
