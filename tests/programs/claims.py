"""The commands behind the documentation's claims (claims.toml): runs them, and keeps when, at which commit, what came.

`--run NAME`, which may be given again, runs one; `--run short` those of some minutes, `--run all` all of them in turn:
before a release, on a quiet machine. The last run of each is a line of docs/measured/claims.tsv, from which
docs/reference/claims.md is written; without --run only that. Exit status 1 where a command failed.

Takes what its commands take: hours, for all of them.
"""

import csv
import os
import re
import shlex
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from tests.programs import FAILED, choose, program

ROOT = Path(__file__).resolve().parents[2]
LIST, KEPT = Path(__file__).with_name("claims.toml"), ROOT / "docs/measured/claims.tsv"
PAGE = ROOT / "docs/reference/claims.md"
LONGEST = 240  # characters of a result

HEAD = """# Claims, and the commands behind them

Each claim of this documentation that a test of every day cannot show has a command that shows it.
`make program NAME=claims ARGS="--run NAME"` runs one, keeps date, commit, duration and result in
`docs/measured/claims.tsv`, and writes this page from it; `--run all` runs all of them, before a release. Beside a claim
stands its last run on this version, {version}: the result of a command that ended with exit status 0, or *failed*. A
commit with `-dirty` had changes that were not committed.

| name | claim | command | run | result |
|---|---|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Claim:
    """What is claimed. page: which document, from the root; result: expression of what is kept of the output."""

    name: str
    claim: str
    page: str
    command: str
    result: str = ""
    short: bool = False


@dataclass(frozen=True, slots=True)
class Run:
    """The last run of a claim's command. date: UTC; version: of the package; commit: as `git describe` has it."""

    name: str
    date: str
    version: str
    commit: str
    minutes: str
    status: str
    result: str


def claims() -> dict[str, Claim]:
    """Return the list."""
    listed = tomllib.loads(LIST.read_text(encoding="utf-8"))
    return {name: Claim(name, **of) for name, of in listed.items()}


def version() -> str:
    """Return the version of this checkout."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]


def runs(path: Path = KEPT) -> dict[str, Run]:
    """Return what is kept: the last run of each claim."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {row["name"]: Run(**row) for row in csv.DictReader(file, dialect="excel-tab")}


def keep(run: Run, path: Path = KEPT) -> None:
    """Put a run in the place of the one before, in the order of the list."""
    known = runs(path) | {run.name: run}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Run)], dialect="excel-tab", lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(known[name]) for name in claims() if name in known)


def said(output: str, claim: Claim) -> str:
    """Return the result of a command: all that its expression finds in the output, or the last line."""
    if claim.result:
        found = [match.group() for match in re.finditer(claim.result, output)]
    else:
        found = output.strip().splitlines()[-1:]
    return " ".join("; ".join(found).split())[:LONGEST]


def carry_out(claim: Claim) -> Run:
    """Run a claim's command, with its output shown meanwhile."""
    words = shlex.split(claim.command)
    if words[0] == "python":
        words = [sys.executable, "-u", *words[1:]]
    now, began = datetime.now(UTC), time.monotonic()
    commit = _git("describe", "--always", "--dirty")
    print(f"{claim.name}: {claim.command}", flush=True)
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, errors="replace") as process:
        assert process.stdout is not None
        output = "".join(_shown(process.stdout))
    minutes = f"{(time.monotonic() - began) / 60.0:.1f}"
    result = said(output, claim) or "(it printed no result)"
    return Run(claim.name, f"{now:%Y-%m-%d}", version(), commit, minutes, str(process.returncode), result)


def _shown(lines: Iterator[str]) -> Iterator[str]:
    for line in lines:
        print(line, end="", flush=True)
        yield line


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip() or "no commit"


def page(listed: Mapping[str, Claim], known: Mapping[str, Run], of: str) -> str:
    """Return the page's text. of: the version that it is about."""
    lines = []
    for claim in listed.values():
        run = known.get(claim.name)
        if run is None or run.version != of:
            when, result = "not run on this version", ""
        else:
            when = f"{run.date}, `{run.commit}`, {run.minutes} min"
            result = f"failed (exit status {run.status}): " * (run.status != "0") + _code(run.result)
        link = _link(claim)
        lines.append(f"| {claim.name} | {link} | `{claim.command}` | {when} | {result} |\n")
    return HEAD.format(version=of) + "".join(lines)


def _link(claim: Claim) -> str:
    if not claim.page.startswith("docs/"):  # at the top of the repository, and elsewhere on the site
        return f"{claim.claim} (`{claim.page}`)"
    return f"[{claim.claim}]({os.path.relpath(ROOT / claim.page, PAGE.parent)})"


def _code(text: str) -> str:
    return f"`{text.replace('|', '/').replace('`', chr(39))}`"


def main(
    run: Annotated[list[str] | None, typer.Option(help="run this one; short or all: these", metavar="NAME")] = None,
    page_file: Annotated[Path, typer.Option("--page", help="write the page here")] = PAGE,
) -> int:
    """Run what is asked for, and write the page."""
    listed, failed = claims(), []
    groups = {"all": list(listed), "short": [name for name, claim in listed.items() if claim.short]}
    asked = [name for word in run or () for name in groups.get(word, [word])]
    for name in choose(asked, listed) if asked else ():
        kept = carry_out(listed[name])
        keep(kept)
        failed += [name] * (kept.status != "0")
    page_file.write_text(page(listed, runs(), version()), encoding="utf-8")
    known = [each for each in runs().values() if each.version == version()]
    print(f"{len(known)} of {len(listed)} claims have a run on version {version()}, {len(asked)} of them now"
          + (f"; failed now: {', '.join(failed)}" if failed else ""))  # fmt: skip
    return FAILED if failed else 0


if __name__ == "__main__":
    program(main)
