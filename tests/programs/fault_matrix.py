"""The fault matrix: each fault at each moment, in lockstep, over the real client and with the real log process.

Writes table.md and table.csv. Exit status 1 where anything was missed. Ctrl-C ends it; started again it goes on, unless
the sources have changed since. --two-clocks: not in lockstep; the arms run in slow motion, by clocks that drift, and do
not wait for the loop. docs/faults.md says how to read the table and to add a fault.

Takes an hour or two.
"""

import csv
import hashlib
import json
import os
import select
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from rtstack.cells import IDEAL, load_description, open_cell, with_profile
from rtstack.log.reader import read_log
from rtstack.samples import Mode
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.programs import choose, program
from tests.support.faults import catalogue as fault_catalogue
from tests.support.faults.case import Ground
from tests.support.faults.catalogue import case_name
from tests.support.faults.hold import hold
from tests.support.faults.model import CaseResult, Fault, Moment
from tests.support.faults.process import CaseProcess, take_charge
from tests.support.runs import attempt, demonstrate

HEAD = ("fault", "moment", "expected", "seen", "ticks", "robot at the end", "log", "recovered", "")


def write_table(results: Sequence[CaseResult], expected_cases: int, folder: Path) -> Path:
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
    path = folder / "table.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with (folder / "table.csv").open("w", newline="", encoding="utf-8") as file:
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


ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("hal", "sim_robot", "rtstack", "deploy", "tests/support/faults")
MISSED = 1
# slow enough that a machine which stalls for some ms loses no packet
TWO_CLOCKS = ("--phase-us", "400", "--drift-ppm", "50", "--slower", "2")


@dataclass(frozen=True, slots=True)
class Choice:
    """What to play, where to write it."""

    cases: tuple[tuple[Fault, Moment], ...]
    jobs: int
    folder: Path
    fresh: bool
    profile: str
    clocks: tuple[str, ...] = ()


def sources_digest() -> str:
    """Return what a result belongs to: the state of everything that is tested, and of these tests."""
    digest = hashlib.sha256()
    for folder in SOURCES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".toml", ".urdf"):
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def make_ground(folder: Path, profile: str, clocks: tuple[str, ...]) -> Ground:
    """Record a demonstration, and find out when its trial meets the box, in a process that is then forgotten.

    Kept for the present sources; what belongs to others is removed.
    """
    for other in folder.parent.glob("*"):
        if other != folder:
            shutil.rmtree(other)
    folder.mkdir(parents=True, exist_ok=True)
    reference, found = folder / "reference.mcap", folder / "impact_tick"
    if not found.exists():
        child = os.fork()
        if child == 0:
            status = 1
            try:
                found.write_text(str(_look_for_impact(reference, profile)))
                status = 0
            finally:
                os._exit(status)
        if os.waitpid(child, 0)[1]:
            raise SystemExit("the demonstration and its trial do not run without any fault: see above")
    description, _ = load_description(None)
    prepared = prepare_trial(TrialSpecification(str(reference), seed=1), description)
    return Ground(prepared, int(found.read_text()), profile, clocks)


def _look_for_impact(reference: Path, profile: str) -> int:
    description, source = load_description(None)
    direct, lockstep = with_profile("direct", profile), with_profile("lockstep", profile)
    demonstrate(reference, description, kind=direct, file=source)
    path = reference.with_name("trial.mcap")
    # what runs in this process runs in lockstep, too, bit for bit
    result = attempt(TrialSpecification(str(reference), seed=1), description, path, kind=direct, file=source)
    if not result.success:
        raise SystemExit(f"the trial without any fault failed: {result.failure_reason}")
    cell = open_cell(lockstep, "rice_box", 0.0, 1, description)  # compiles what only the server needs
    hold(cell, description)
    cell.close()
    return int(np.flatnonzero(read_log(path).topic("/left/control")["mode"] == Mode.INTERIM)[0])


class Kept:
    """Results by case, kept for the present sources."""

    def __init__(self, folder: Path, digest: str) -> None:
        self._folder, self._digest = folder, digest
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, name: str) -> CaseResult | None:
        """Return a kept result."""
        path = self._folder / f"{name}.json"
        if not path.exists():
            return None
        kept = json.loads(path.read_text())
        return CaseResult(**kept["result"]) if kept["sources"] == self._digest else None

    def put(self, name: str, result: CaseResult) -> None:
        """Keep a result."""
        document = json.dumps({"sources": self._digest, "result": result.as_dict()})
        (self._folder / f"{name}.json").write_text(document)


def play(choice: Choice) -> list[CaseResult]:
    """Play what is not kept; return all results in the order of the choice. KeyboardInterrupt leaves no process."""
    digest = f"{sources_digest()}-{choice.profile}{'-clocks' if choice.clocks else ''}"
    kept = Kept(choice.folder / "cases", digest)
    results: dict[str, CaseResult] = {}
    waiting = []
    for fault, moment in choice.cases:
        old = None if choice.fresh else kept.get(case_name(fault, moment))
        if old is None:
            waiting.append((fault, moment))
        else:
            results[case_name(fault, moment)] = old
    running: list[CaseProcess] = []
    began_s, count, done = time.monotonic(), len(waiting), 0
    try:
        if waiting:
            print(f"{count} cases, {len(results)} kept; recording the demonstration they stand on", flush=True)
            ground = make_ground(
                choice.folder / "ground" / f"{digest[:16]}-{choice.profile}", choice.profile, choice.clocks
            )
            began_s = time.monotonic()
        while waiting or running:
            while waiting and len(running) < choice.jobs:
                fault, moment = waiting.pop(0)
                running.append(CaseProcess(fault, moment, ground, choice.folder / "runs" / case_name(fault, moment)))
            select.select([case.descriptor for case in running], (), (), 1.0)
            for case in [case for case in running if case.ended or case.hangs]:
                running.remove(case)
                name, result = case_name(case.fault, case.moment), case.result()
                kept.put(name, result)
                results[name], done = result, done + 1
                _say(result, done, count, began_s)
    finally:
        for case in running:
            case.kill()
        ordered = [results[name] for name in (case_name(*case) for case in choice.cases) if name in results]
        path = write_table(ordered, len(choice.cases), choice.folder)
        missed = sum(bool(result.misses) for result in ordered)
        print(f"{len(ordered)} of {len(choice.cases)} cases, {missed} missed: {path}", flush=True)
    return ordered


def _say(result: CaseResult, done: int, count: int, began_s: float) -> None:
    left_s = (time.monotonic() - began_s) / done * (count - done)
    line = f"{done}/{count}, about {left_s / 60:.1f} min left | {result.fault}, {result.moment}: "
    print(line + (f"MISSED: {'; '.join(result.misses)}" if result.misses else "ok"), flush=True)


def main(
    faults: Annotated[list[str] | None, typer.Option("--fault", help="only this one")] = None,
    moments: Annotated[list[Moment] | None, typer.Option("--moment", help="only this one")] = None,
    names_of_cases: Annotated[list[str] | None, typer.Option("--case", help="only this one: nan-torque.ante")] = None,
    jobs: Annotated[int, typer.Option(help="cases at a time")] = 2,
    out: Path = ROOT / "out" / "faults",
    fresh: Annotated[bool, typer.Option("--fresh", help="play again what is kept")] = False,
    profile: Annotated[str, typer.Option(help="of the simulated robot: ideal, honest, harsh")] = IDEAL,
    two_clocks: Annotated[bool, typer.Option("--two-clocks", help="arms that do not wait for the loop")] = False,
) -> int:
    """Play the chosen cases."""
    choose(faults, [fault.name for fault in fault_catalogue.FAULTS])
    if jobs < 1:
        raise typer.BadParameter("--jobs must be 1 or more")
    jobs = 1 if two_clocks else jobs  # each loop has the last CPU to itself
    cases = tuple(
        (fault, moment)
        for fault in fault_catalogue.FAULTS
        for moment in Moment
        if (not faults or fault.name in faults)
        and (not moments or moment in moments)
        and (not names_of_cases or case_name(fault, moment) in names_of_cases)
        and not (two_clocks and fault.shared_clock)
    )
    if not cases:
        raise typer.BadParameter("there is no such case")
    clocks = TWO_CLOCKS if two_clocks else ()
    choice = Choice(cases, jobs, out, fresh, profile, clocks)
    take_charge()
    return MISSED if any(result.misses for result in play(choice)) else 0


if __name__ == "__main__":
    program(main)
