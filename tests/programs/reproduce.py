"""Every table and figure of the three papers, of the reality page and of the documentation, made again on this machine.

Runs each campaign of deploy/campaigns that a figure or table stands on, then the documentation with its own figures,
and writes one page: what each paper claims, what came out, and why where it differs, with date, commit and durations.
Ctrl-C at any moment: the same command goes on where it was. --data: where the measurements for the campaign reality
are; without them that step is left out, and said. --quick: a sample of each. Exit status 1 where a step has failed.

Takes 40 minutes on two cores; with --quick five minutes.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from hal.base.files import write_whole
from rtstack.experiments.claims import ClaimStatus
from rtstack.experiments.report import NUMBERS
from tests.programs import program

ROOT = Path(__file__).resolve().parents[2]
STATE = "steps.json"
RTSTACK = (sys.executable, "-m", "rtstack")
CAMPAIGNS = {  # in the order of the papers
    "reference-spreading": "Reference spreading: Table II, Figures 8, 10 and 11",
    "reference-spreading-hands": "Reference spreading: which hands, laws and pads the claims hold with",
    "reference-spreading-panda": "Reference spreading: Table II in a cell of two Pandas",
    "reference-spreading-sensitivity": "Reference spreading: what makes the controllers fail",
    "aim-aware-planar": "Aim-aware monitoring: the planar study",
    "aim-aware-arm": "Aim-aware monitoring: an arm before an inclined platform",
    "aim-aware-grab": "Aim-aware monitoring: grabs with faults",
    "impact-map-validation": "Impact maps: Tables II and III",
    "impact-map-sensitivity": "Impact maps: robots that are not what the map counts on",
    "reality": "Models beside measurements of real robots",
}
# what takes longer than the rest together, sampled as it may be
NOT_IN_THE_SAMPLE = (
    "reference-spreading", "reference-spreading-hands", "reference-spreading-sensitivity", "impact-map-sensitivity",
)  # fmt: skip
LAST = (  # run in this order: what an interruption should cost comes last
    "reference-spreading", "aim-aware-planar", "aim-aware-arm", "reference-spreading-sensitivity",
    "reference-spreading-panda", "reference-spreading-hands", "impact-map-validation", "impact-map-sensitivity",
    "aim-aware-grab", "reality",
)  # fmt: skip
PAPERS = {
    "reference-spreading": "Reference spreading",
    "aim-aware": "Aim-aware monitoring",
    "impact-map": "Impact maps",
}
FIGURES = {  # that the page shows, of a campaign's report; copied beside it
    "reference-spreading-hands": ("hands.png",),
    "aim-aware-planar": ("figure7.png",),
    "aim-aware-arm": ("figure8.png",),
}
MEASURED = "measured"  # the folder of pictures beside the page
MANY = 20  # conditions: of more, the page counts in how many each claim holds
GOOD = (ClaimStatus.HOLDS, ClaimStatus.WITHIN)
DOCUMENTS = "documents"
NOMINAL = "nominal"  # the condition of which the others of a sensitivity campaign are departures


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked for."""

    quick: bool
    data: Path | None
    workers: int
    out: Path


@dataclass(frozen=True, slots=True)
class Step:
    """One step that has ended: whether it was right, how long all its runs took, when it ended, and of which commit."""

    ok: bool
    seconds: float
    ended: str
    commit: str


def commands(options: Options, name: str) -> list[str]:
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


def run(options: Options) -> dict[str, Step]:
    """Run what has not ended well yet; return all that has ended."""
    state = options.out / STATE
    known = json.loads(state.read_text()) if state.exists() else {}
    ended = {name: Step(**step) for name, step in known.get("ended", {}).items()}
    spent: dict[str, float] = known.get("spent", {})
    names = [name for name in CAMPAIGNS if name != "reality" or options.data is not None]
    if options.quick:
        names = [name for name in names if name not in NOT_IN_THE_SAMPLE]
    names.sort(key=LAST.index)
    if "reality" in names:
        package = str(ROOT / "examples" / "reality")
        subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", package], check=True)
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


def page(options: Options, ended: Mapping[str, Step]) -> str:
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
        missing = "not in the sample" if out else "not run" + ": its data is not here" * (name == "reality")
        reported = (options.out / name / NUMBERS).exists()
        word = missing if step is None else "" if step.ok else "not all could be run" if reported else "FAILED"
        lines.append(f"| {title} (`{name}`) | {'' if step is None else f'{step.seconds / 60.0:.1f}'} | {word} |")
    reports = {
        name: json.loads(file.read_text())
        for name in CAMPAIGNS
        if name in ended and (file := options.out / name / NUMBERS).exists()
    }
    lines += ["", *_summary(reports), "", *READING]
    for name, report in reports.items():
        lines += ["", f"## {CAMPAIGNS[name]}", "", *_fixed(report), "", *_claims(report), *_tables(report)]
        for figure in FIGURES.get(name, ()):
            if (options.out / name / "figures" / figure).exists():
                lines += ["", f"![{CAMPAIGNS[name]}]({MEASURED}/{name}-{figure})"]
    return "\n".join(lines) + "\n"


READING = [
    "Each claim is a line of the campaign's plan, fixed before its cases were run. *Claimed by the paper* has what the "
    "paper says, *our own mark* what this project asks for where the paper gives no bound. *Holds*: 95 % intervals, or "
    "a complete count, exclude the opposite. *Holds, within the intervals*: the means are as claimed, the intervals do "
    "not exclude the opposite. *Differs*: the intervals exclude the claim. *Cannot be told*: nothing tells, or the "
    "means are against the claim and the intervals do not exclude it. All robots are simulated. Where the code departs "
    "from the papers: [Departures](departures.md)."
]


def _summary(reports: Mapping[str, Mapping]) -> list[str]:
    """Return how many claims hold, by paper: each campaign's first conditions, without marks of our own alone."""
    lines = [
        "| claims of the papers | hold | hold, within the intervals | differ | cannot be told |",
        "|---|---:|---:|---:|---:|",
    ]
    for prefix, paper in PAPERS.items():
        for name, report in reports.items():
            if not name.startswith(prefix) or len(report["conditions"]) > MANY:
                continue
            claims = [claim for claim in report["conditions"][0]["claims"] if claim["claim"]]
            counts = [sum(claim["verdict"] == status for claim in claims) for status in
                      (ClaimStatus.HOLDS, ClaimStatus.WITHIN, ClaimStatus.DIFFERS, ClaimStatus.UNDECIDED)]  # fmt: skip
            if claims:
                lines.append(_line(f"{paper}: `{name}`, {report['conditions'][0]['name']}", *map(str, counts)))
    return lines


def _fixed(report: Mapping) -> list[str]:
    """Return how the plan was fixed, and on what its parameters were chosen."""
    fixed = report["registration"]
    words = f"Plan fixed by commit `{fixed['commit'][:12]}`, SHA-256 `{fixed['first_digest'][:16]}`."
    if fixed["changed"]:
        words += f" **Its file was changed after results existed**: SHA-256 now `{fixed['digest'][:16]}`."
    for what, key in (("Left out", "excluded"), ("Chosen on", "chosen_on"), ("Changed later", "deviations")):
        if fixed[key]:
            words += f" {what}: {'; '.join(fixed[key])}."
    return [words]


def _tables(report: Mapping) -> list[str]:
    """Return the tables that stand beside those of the paper, of all conditions where these are few."""
    lines: list[str] = []
    if len(report["conditions"]) > MANY:
        return lines
    for condition in report["conditions"]:
        for table in condition.get("tables", ()):
            if table["title"].startswith(("Table", "Figure")):
                of = f", {condition['name'].replace('_', ' ')}" if len(report["conditions"]) > 1 else ""
                head = [_line(*table["headings"]), "|" + "---|" * len(table["headings"])]
                lines += ["", f"*{table['title']}{of}*", "", *head, *(_line(*line) for line in table["lines"])]
                lines += ["", table["note"]] if table["note"] else []
    return lines


def _commit() -> str:
    said = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return said.stdout.strip() or "unknown"


def _claims(report: Mapping) -> list[str]:
    """Return a table of claims; of conditions that differ from the one named nominal on purpose, only the verdicts."""
    conditions, beside = report["conditions"], []
    if len(conditions) > MANY:
        return _counted(conditions)
    if len(conditions) > 1 and conditions[0]["name"] == NOMINAL:
        conditions, beside = conditions[:1], conditions[1:]
    lines = ["| where | claimed by the paper | our own mark | came out | | why |", "|---|---|---|---|---|---|"]
    for condition in conditions:
        for claim in condition["claims"]:
            where = f"{condition['name']}: {claim['where']}" if len(conditions) > 1 else claim["where"]
            why = "" if claim["verdict"] == ClaimStatus.HOLDS else claim["why"]
            lines.append(_line(where, claim["claim"], claim["mark"], claim["figures"], claim["verdict"], why))
    if len(lines) == 2:
        return ["Its report has tables and figures, and no claim of the paper's."]
    return lines + (["", *_verdicts(beside)] if beside else [])


def _counted(conditions: Sequence[Mapping]) -> list[str]:
    """Return for each claim under how many conditions it came out how."""
    keys = dict.fromkeys((claim["where"], claim["claim"]) for part in conditions for claim in part["claims"])
    statuses = (ClaimStatus.HOLDS, ClaimStatus.WITHIN, ClaimStatus.DIFFERS, ClaimStatus.UNDECIDED)
    lines = [_line("where", "claimed by the paper", *statuses), "|---|---|---:|---:|---:|---:|"]
    for where, says in keys:
        found = [claim["verdict"] for part in conditions for claim in part["claims"]
                 if (claim["where"], claim["claim"]) == (where, says)]  # fmt: skip
        lines.append(_line(where, says, *(str(found.count(status)) for status in statuses)))
    return [f"Under {len(conditions)} conditions:", "", *lines]


def _verdicts(conditions: Sequence[Mapping]) -> list[str]:
    """Return for each condition how many claims hold, and which do not."""
    lines = ["| beside it, on purpose | claims that hold | that do not, or cannot be told |", "|---|---|---|"]
    for condition in conditions:
        claims = condition["claims"]
        others = [claim for claim in claims if claim["verdict"] not in GOOD]
        words = "; ".join(f"{claim['where']}: {claim['claim']} ({claim['verdict']})" for claim in others)
        lines.append(_line(condition["name"], f"{len(claims) - len(others)} of {len(claims)}", words))
    return lines


def _line(*words: str) -> str:
    return "| " + " | ".join(str(word).replace("|", "\\|").replace("\n", " ") for word in words) + " |"


def main(
    quick: Annotated[bool, typer.Option("--quick", help="a sample of each campaign")] = False,
    data: Annotated[Path | None, typer.Option(help="measurements for reality: docs/reality.md says which")] = None,
    workers: int = os.cpu_count() or 1,
    out: Annotated[Path | None, typer.Option(help="default: out/reproduce, or out/reproduce-quick")] = None,
    page_file: Annotated[Path | None, typer.Option("--page", help="also write the page here")] = None,
) -> int:
    """Make all of it, and the page."""
    out = out or ROOT / "out" / ("reproduce-quick" if quick else "reproduce")
    out.mkdir(parents=True, exist_ok=True)
    options = Options(quick, data, workers, out)
    ended = run(options)
    text = page(options, ended)
    for file in filter(None, (out / "reproduced.md", page_file)):
        write_whole(file, text)
        for name, figures in FIGURES.items():
            for figure in figures:
                if (drawn := out / name / "figures" / figure).exists():
                    (file.parent / MEASURED).mkdir(exist_ok=True)
                    shutil.copyfile(drawn, file.parent / MEASURED / f"{name}-{figure}")
    print(f"reproduce: {out / 'reproduced.md'}")
    rows = re.findall(r"(?m)^\| [^|]+: `[^`|]+`, [^|]+ \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|$", text)
    sums = [sum(map(int, column)) for column in zip(*rows, strict=True)] or [0] * 4
    print("claims of the papers: {} hold, {} within the intervals, {} differ, {} cannot be told".format(*sums))
    return 0 if all(step.ok for step in ended.values()) else 1


if __name__ == "__main__":
    program(main)
