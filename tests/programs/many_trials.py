"""A campaign of very many short trials through the ordinary `rtstack campaign`: does it end well, in how much memory?

    python -m tests.programs.many_trials WORK [--trials 20000] [--workers 2]

A trial is the cell built anew, some milliseconds of the motion of all joints, its log and a row. The memory of all
processes is in WORK/memory.csv every 10 s: time s, trials done, processes, sum, runner, largest worker, MB. The same
command goes on where it was ended. Logs but every LOG_KEPT-th are removed by the worker that wrote them.
"""

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import psutil

from hal.configuration import load_toml
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Task
from rtstack.experiments.report import Report
from rtstack.experiments.store import DATABASE, Store

KIND, OBJECT = "short-trials", "rice_box"
ROOT = Path(__file__).resolve().parents[2]
TICKS = 20
LOG_KEPT = 1000
SAMPLE_S = 10.0
COLUMNS = {"number": int, "ticks": int, "failed": str, "log_bytes": int}
MB = 1e6


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan's file."""

    kind: str
    name: str
    title: str
    trials: int
    quick: bool = False

    def size(self) -> int:
        """See Specification."""
        return self.trials


@dataclass(frozen=True, slots=True)
class Short:
    """A trial."""

    number: int

    @property
    def id(self) -> str:
        """See Case."""
        return f"{self.number:06d}"


class ShortTrials(Experiment[Plan, Short]):
    """See the module."""

    def __init__(self, specification: Plan, request: Request) -> None:
        super().__init__(specification, request, COLUMNS, [request.file.path])

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        """See Experiment."""
        return load_toml(path, Plan)

    def cases(self, rows: Sequence[Row]) -> list[Short]:
        """See Experiment."""
        return [Short(number) for number in range(self.specification.trials)]

    def tasks(self, cases: Sequence[Short]) -> Iterable[Task]:
        """See Experiment."""
        (self.request.out / "logs").mkdir(exist_ok=True)
        return (Task(case.id, run_short, (case, self.request.out / "logs"), (case,)) for case in cases)

    def report(self, results: Results) -> Report:
        """See Experiment."""
        failed = sum(bool(row["failed"]) for row in results.rows)
        return Report([], summary=f"{len(results.rows)} trials, {failed} failed", reached=not failed)


@lru_cache(maxsize=1)
def _bench() -> tuple[Any, ...]:
    from rtstack.cells import load_description
    from rtstack.identification.procedure import uncompensated
    from rtstack.identification.sweep import all_joints
    from rtstack.loop.session import SessionPlan
    from rtstack.trials.assembly import arm_controllers
    from rtstack.trials.record import frames

    description, source = load_description(None)
    parameters = uncompensated()
    whole = all_joints(description, arm_controllers(description, parameters), 0)
    points = whole.ante[:, :TICKS].copy()
    plan = SessionPlan(points, points, whole.mode, whole.stiffness, whole.period_s)
    return description, source, parameters, plan, frames(description, OBJECT)


def run_short(case: Short, logs: Path) -> list[Row]:
    """Run a trial; return its row."""
    from rtstack.cells import open_cell
    from rtstack.trials.motion import run_motion
    from rtstack.trials.run_context import RunContext
    from rtstack.trials.whole_run_log import WholeRunLog

    description, source, parameters, plan, frames = _bench()
    path = logs / f"{case.id}.mcap"
    cell = open_cell("direct", OBJECT, 0.0, case.number, description, cell_file=source)
    try:
        log = WholeRunLog(path, {"trial": {"kind": "identification", "number": str(case.number)}}, [], frames)
        failed, columns = run_motion(plan, description, parameters, cell, RunContext(log))
    finally:
        cell.close()
    size = path.stat().st_size
    if case.number % LOG_KEPT:
        path.unlink()
    ticks = int(columns.arm.shape[1])
    return [{"id": case.id, "number": case.number, "ticks": ticks, "failed": failed or "", "log_bytes": size}]


def install(work: Path) -> dict[str, str]:
    """Write what makes `rtstack` find the kind; return the environment in which it does."""
    metadata = work / "installed" / "short_trials-1.dist-info"
    metadata.mkdir(parents=True, exist_ok=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: short-trials\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(f"[rtstack.experiments]\n{KIND} = {__spec__.name}:ShortTrials\n")
    places = [str(metadata.parent), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(places)}


def memory_of(process: psutil.Process) -> tuple[int, float, float, float]:
    """Return how many processes there are, and MB: of all, of the first, of the largest other one."""
    own, children = process.memory_info().rss / MB, []
    for child in process.children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            children.append(child.memory_info().rss / MB)
    return 1 + len(children), own + sum(children), own, max(children, default=0.0)


def main() -> int:
    """Run it; 1 where it did not end well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--trials", type=int, default=20_000)
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    work: Path = chosen.work.resolve()
    environment, out = install(work), work / "out"
    plan = work / "short.toml"
    if not plan.exists():
        plan.write_text(f'kind = "{KIND}"\nname = "short"\ntitle = "Short trials"\ntrials = {chosen.trials}\n')
    words = [str(Path(sys.executable).parent / "rtstack"), "campaign", str(plan), "--out", str(out)]
    words += ["--workers", str(chosen.workers), *["--resume"] * (out / DATABASE).exists()]
    began_s = time.monotonic()
    with open(work / "said.txt", "ab") as said, open(work / "memory.csv", "a") as memory:
        process = psutil.Popen(words, stdout=said, stderr=said, env=environment)
        while True:
            try:
                process.wait(SAMPLE_S)
                break
            except psutil.TimeoutExpired:
                pass
            with contextlib.suppress(psutil.Error, OSError, ValueError, KeyError):
                done = json.loads((out / "progress.json").read_text())["done"]
                count, *megabytes = memory_of(process)
                figures = ",".join(f"{value:.1f}" for value in megabytes)
                print(f"{time.monotonic() - began_s:.0f},{done},{count},{figures}", file=memory, flush=True)
    with Store(out, COLUMNS) as store:
        rows = store.rows()
    failed = sum(bool(row["failed"]) for row in rows)
    print(f"exit status {process.returncode}; {len(rows)} rows, {failed} failed trials, "
          f"{time.monotonic() - began_s:.0f} s; results {(out / DATABASE).stat().st_size / MB:.1f} MB, "
          f"a log {sum(row['log_bytes'] for row in rows) / max(1, len(rows)) / 1e3:.0f} kB")  # fmt: skip
    print("| trials done | processes | all MB | runner MB | largest worker MB |\n|---:|---:|---:|---:|---:|")
    samples = [tuple(map(float, line.split(","))) for line in (work / "memory.csv").read_text().splitlines()]
    for share in (0.05, 0.1, 0.25, 0.5, 0.75, 1.0):
        near = [sample for sample in samples if sample[1] <= share * chosen.trials]
        if near:
            _, done, count, every, runner, worker = near[-1]
            print(f"| {done:,.0f} | {count:.0f} | {every:.0f} | {runner:.0f} | {worker:.0f} |")
    return 0 if process.returncode == 0 and len(rows) == chosen.trials else 1


if __name__ == "__main__":
    sys.exit(main())
