"""Every table and figure of the three papers, of the reality page and of the documentation, made again on this machine.

    python -m tests.programs.reproduce [--quick] [--data DIR] [--workers N] [--out DIR] [--page FILE]

Runs each campaign of deploy/campaigns that a figure or table stands on, then the documentation with its own figures,
and writes one page: what each paper claims, what came out, and why where it differs, with date, commit and durations.
Ctrl-C at any moment: the same command goes on where it was. --data: where the measurements for the campaign reality
are; without them that step is left out, and said. --quick: a sample of each. Exit status 1 where a step has failed.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from hal.files import write_whole
from rtstack.experiments.claims import ClaimStatus
from rtstack.experiments.report import NUMBERS

ROOT = Path(__file__).resolve().parents[2]
STATE = "steps.json"
RTSTACK = (sys.executable, "-m", "rtstack")
CAMPAIGNS = {  # in the order of the papers
    "reference-spreading": "Reference spreading: force norms, Table II, Figure 11",
    "reference-spreading-panda": "Reference spreading: Table II in a cell near the paper's",
    "reference-spreading-sensitivity": "Reference spreading: what the order of Table II depends on",
    "aim-aware-planar": "Aim-aware monitoring: the planar study",
    "aim-aware-arm": "Aim-aware monitoring: an arm before an inclined platform",
    "aim-aware-grab": "Aim-aware monitoring: grabs with faults",
    "impact-map-validation": "Impact maps: Tables II and III",
    "impact-map-sensitivity": "Impact maps: robots that are not what the map counts on",
    "reality": "Models beside measurements of real robots",
}
# what takes longer than the rest together, sampled as it may be
NOT_IN_THE_SAMPLE = ("reference-spreading", "reference-spreading-sensitivity", "impact-map-sensitivity")
DOCUMENTS = "documents"
NOMINAL = "nominal"  # the condition of which the others of a sensitivity campaign are departures


@dataclass(frozen=True, slots=True)
class Step:
    """One step that has ended: whether it was right, how long all its runs took, when it ended, and of which commit."""

    ok: bool
    seconds: float
    ended: str
    commit: str


def commands(options: argparse.Namespace, name: str) -> list[str]:
    """Return the command of a step."""
    if name == DOCUMENTS:
        return [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir",
                str(options.out.resolve() / "site")]  # fmt: skip
    folder = options.out / name
    asked = [*RTSTACK, "campaign", name, "--out", str(folder), "--workers", str(options.workers)]
    return (
        asked
        + ["--resume"] * folder.exists()
        + ["--quick"] * options.quick
        + (["--data", str(options.data)] if name == "reality" else [])
    )


def run(options: argparse.Namespace) -> dict[str, Step]:
    """Run what has not ended well yet; return all that has ended."""
    state = options.out / STATE
    known = json.loads(state.read_text()) if state.exists() else {}
    ended = {name: Step(**step) for name, step in known.get("ended", {}).items()}
    spent: dict[str, float] = known.get("spent", {})
    names = [name for name in CAMPAIGNS if name != "reality" or options.data is not None]
    if options.quick:
        names = [name for name in names if name not in NOT_IN_THE_SAMPLE]
    wanted = [name for name in [*names, DOCUMENTS] if not (name in ended and ended[name].ok)]
    for k, name in enumerate(wanted):
        print(f"reproduce: {k + 1} of {len(wanted)}: {name}", file=sys.stderr, flush=True)
        began = time.monotonic()
        try:
            status = subprocess.run(commands(options, name), cwd=ROOT, check=False).returncode
        finally:
            spent[name] = spent.get(name, 0.0) + time.monotonic() - began
            write_whole(
                state, json.dumps({"ended": {each: asdict(step) for each, step in ended.items()}, "spent": spent})
            )
        if status in (-signal.SIGINT, 128 + signal.SIGINT):
            raise KeyboardInterrupt
        when = datetime.now(UTC).isoformat(timespec="minutes")
        ended[name] = Step(status == 0, round(spent[name], 1), when, _commit())
        write_whole(state, json.dumps({"ended": {each: asdict(step) for each, step in ended.items()}, "spent": spent}))
    return ended


def page(options: argparse.Namespace, ended: Mapping[str, Step]) -> str:
    """Return the page, as Markdown."""
    total_min = sum(step.seconds for step in ended.values()) / 60.0
    lines = [
        "# Reproduced",
        "",
        f"`make reproduce{' QUICK=1`: a sample of the trials' if options.quick else '`: all trials'}, by version "
        f"{version('rtstack')}. Commit {', '.join(sorted({step.commit for step in ended.values()}))}, "
        f"{max((step.ended for step in ended.values()), default='never')}, "
        f"{options.workers} workers on {os.cpu_count()} CPUs: {total_min:.0f} minutes.",
        "",
        "| what | minutes | |",
        "|---|---:|---|",
    ]
    for name, title in {**CAMPAIGNS, DOCUMENTS: "The documentation, with its figures"}.items():
        step = ended.get(name)
        out = options.quick and name in NOT_IN_THE_SAMPLE
        missing = "not in the sample" if out else "not run: its data is not here"
        word = missing if step is None else "" if step.ok else "FAILED"
        lines.append(f"| {title} (`{name}`) | {'' if step is None else f'{step.seconds / 60.0:.1f}'} | {word} |")
    for name, title in CAMPAIGNS.items():
        file = options.out / name / NUMBERS
        if name in ended and file.exists():
            lines += ["", f"## {title}", "", *_claims(json.loads(file.read_text()))]
    return "\n".join(lines) + "\n"


def _commit() -> str:
    said = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return said.stdout.strip() or "unknown"


def _claims(report: Mapping) -> list[str]:
    """Return a table of claims; of conditions that differ from the one named nominal on purpose, only the verdicts."""
    conditions, beside = report["conditions"], []
    if len(conditions) > 1 and conditions[0]["name"] == NOMINAL:
        conditions, beside = conditions[:1], conditions[1:]
    lines = ["| where | claimed | came out | | why |", "|---|---|---|---|---|"]
    for condition in conditions:
        for claim in condition["claims"]:
            where = f"{condition['name']}: {claim['where']}" if len(conditions) > 1 else claim["where"]
            why = "" if claim["verdict"] == ClaimStatus.HOLDS else claim["why"]
            lines.append(_line(where, claim["claim"], claim["figures"], claim["verdict"], why))
    if len(lines) == 2:
        return ["Its report has tables and figures, and no claim of the paper's."]
    return lines + (["", *_verdicts(beside)] if beside else [])


def _verdicts(conditions: Sequence[Mapping]) -> list[str]:
    """Return for each condition how many claims hold, and which do not."""
    lines = ["| beside it, on purpose | claims that hold | that do not, or cannot be told |", "|---|---|---|"]
    for condition in conditions:
        claims = condition["claims"]
        others = [claim for claim in claims if claim["verdict"] not in (ClaimStatus.HOLDS, ClaimStatus.WITHIN)]
        words = "; ".join(f"{claim['where']}: {claim['claim']} ({claim['verdict']})" for claim in others)
        lines.append(_line(condition["name"], f"{len(claims) - len(others)} of {len(claims)}", words))
    return lines


def _line(*words: str) -> str:
    return "| " + " | ".join(str(word).replace("|", "\\|").replace("\n", " ") for word in words) + " |"


def main() -> int:
    """Make all of it, and the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a sample of each campaign")
    parser.add_argument("--data", type=Path, help="measurements for the campaign reality: docs/reality.md says which")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, help="default: out/reproduce, or out/reproduce-quick")
    parser.add_argument("--page", type=Path, help="where the page goes, too; it is OUT/reproduced.md anyway")
    options = parser.parse_args()
    options.out = options.out or ROOT / "out" / ("reproduce-quick" if options.quick else "reproduce")
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        ended = run(options)
    except KeyboardInterrupt:
        print("reproduce: ended early: the same command goes on from here", file=sys.stderr)
        return 130
    text = page(options, ended)
    for file in filter(None, (options.out / "reproduced.md", options.page)):
        write_whole(file, text)
    print(f"reproduce: {options.out / 'reproduced.md'}")
    return 0 if all(step.ok for step in ended.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
