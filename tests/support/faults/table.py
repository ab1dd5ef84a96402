"""The table of the matrix, for people (Markdown) and programs (CSV)."""

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from tests.support.faults.model import CaseResult

HEAD = ("fault", "moment", "expected", "seen", "ticks", "robot at the end", "log", "recovered", "")


def write_table(results: Sequence[CaseResult], expected_cases: int, folder: Path, name: str = "table") -> Path:
    """Write the table as .md and .csv; return the first one's path."""
    missed = [result for result in results if result.misses]
    lines = [
        "# Faults",
        "",
        f"{len(results)} of {expected_cases} cases, {len(missed)} missed.",
        "Ticks: from where the loop can see the fault to the first stopping torque, of those allowed.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "|" + " --- |" * len(HEAD),
    ]
    lines += ["| " + " | ".join(_cell(text) for text in _row(result)) + " |" for result in results]
    if missed:
        lines += ["", "## Missed", ""]
        lines += [f"- {r.fault}, {r.moment}: {'; '.join(r.misses)}. It said: {r.said or 'nothing'}" for r in missed]
    path = folder / f"{name}.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(CaseResult)])
        for result in results:
            values = result.as_dict() | {"misses": "; ".join(result.misses)}
            writer.writerow(values.values())
    return path


def _row(r: CaseResult) -> tuple[str, ...]:
    ticks = "" if r.latency_ticks is None else f"{r.latency_ticks} of {r.allowed_ticks}"
    return r.fault, r.moment, r.expected, r.seen, ticks, r.robot, r.log, r.recovered, "MISSED" if r.misses else "ok"


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "/").split())
