"""What a campaign costs as it grows from 100 to 100,000 trials: measured parts, and the table that is computed of them.

    python -m tests.programs.growth WORK [--trials 200] [--engine 100 1000] [--report 100 1000] [--seconds 300]

Real trials, with logs, run as `rtstack campaign`, whose memory is sampled; then the engine alone, with tasks that do
nothing; then reports of so many rows as the trials gave. Each part is kept in WORK/growth.json and not measured again.
After so many seconds the program ends; the same command goes on. Logs of trials that are done are removed but for
some hundred: 20,000 are 200 GB.
"""

import argparse
import contextlib
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import psutil

from rtstack.experiments.experiment import Experiment, Request, Results, Row, Task
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.progress import Progress
from rtstack.experiments.registry import plan_file
from rtstack.experiments.report import Report, write_report
from rtstack.experiments.runner import Runner
from rtstack.experiments.store import DATABASE, PROVENANCE, Store
from rtstack.experiments.workers import local_workers
from rtstack.papers.demonstrations import LOGS, RECORDINGS
from rtstack.papers.reference_spreading.experiment import ControllerComparison
from rtstack.papers.reference_spreading.plan import Plan
from rtstack.papers.reference_spreading.trial import Trial

SIZES = (100, 1_000, 10_000, 100_000)
CONTROLLERS, PLACES, MOST_REPETITIONS = 5, 2, 1000  # of the plan that is grown
KEPT_LOGS = 100  # the first, which the report shows, and the last ones
SAMPLE_S = 1.0
MB = 1e6


def write_plan(path: Path, trials: int) -> None:
    """Write the paper's plan with so many trials of one displacement to each side."""
    text = plan_file("reference-spreading").path.read_text().partition("[[experiments]]")[0]
    each = CONTROLLERS * PLACES
    references = max(1, -(-trials // (each * MOST_REPETITIONS)))
    names = ", ".join(f'"rice_box/{number}"' for number in range(references))
    text += f'[[experiments]]\nname = "table2"\nreferences = [{names}]\ndisplacements_mm = [-30.0, 30.0]\n'
    path.write_text(f"{text}repetitions = {max(1, trials // (each * references))}\n")


def comparison(plan: Path, out: Path) -> ControllerComparison:
    """Return the campaign of a plan."""
    out.mkdir(parents=True, exist_ok=True)
    return ControllerComparison(ControllerComparison.read(plan, False), Request(PlanFile(plan, "commit"), out))


def resident_mb(process: psutil.Process) -> dict[str, float]:
    """Return the memory of the campaign's own process, and the largest worker's."""
    workers = [0.0]
    for child in process.children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            workers.append(child.memory_info().rss / MB)
    return {"runner_mb": process.memory_info().rss / MB, "worker_mb": max(workers)}


def run_trials(work: Path, trials: int, until_s: float) -> dict[str, Any] | None:
    """Run real trials until there are so many; return their figures, None where there was no time for all of them."""
    plan, out = work / "trials.toml", work / "trials"
    if not plan.exists():
        write_plan(plan, trials)
    words = [str(Path(sys.executable).parent / "rtstack"), "campaign", str(plan), "--out", str(out), "--workers", "2"]
    words += ["--resume"] * (out / DATABASE).exists()
    over_time = work / "memory.csv"
    sizes = work / "log_bytes.csv"
    with open(work / "trials.txt", "ab") as said, open(over_time, "a") as memory, open(sizes, "a") as logs:
        process = psutil.Popen(words, stdout=said, stderr=said)
        measured: set[str] = set()
        while process.poll() is None:
            if time.monotonic() > until_s:
                process.terminate()
            time.sleep(SAMPLE_S)
            there = sorted((out / "logs").glob("*.mcap"), key=lambda path: path.stat().st_mtime)
            for path in there:
                if path.name not in measured:
                    measured.add(path.name)
                    print(path.stat().st_size, file=logs)
            for path in there[KEPT_LOGS:-KEPT_LOGS]:
                path.unlink()
            with contextlib.suppress(psutil.Error, OSError, ValueError, KeyError):
                done = json.loads((out / "progress.json").read_text())["done"]
                used = resident_mb(process)
                print(f"{done},{used['runner_mb']:.1f},{used['worker_mb']:.1f}", file=memory, flush=True)
    experiment = comparison(plan, out)
    with Store(out, experiment.columns) as store:
        rows, invocations = store.rows(), store.invocations()
    if len(rows) < trials:
        print(f"{len(rows)} of {trials} trials: the same command goes on", file=sys.stderr)
        return None
    samples = [tuple(map(float, line.split(","))) for line in over_time.read_text().splitlines()]
    wall_s, robot_s = (sum(each[name] for each in invocations) for name in ("wall_s", "robot_s"))
    return {
        "trials": len(rows), "wall_s": wall_s, "robot_s": robot_s,
        "task_s": statistics.fmean(row["wall_s"] for row in rows),
        "log_mb": statistics.fmean(int(line) for line in sizes.read_text().split()) / MB,
        "memory": [_at(samples, share * len(rows)) for share in (0.1, 0.5, 1.0)],
    }  # fmt: skip


def _at(samples: Sequence[tuple[float, ...]], done: float) -> tuple[float, ...]:
    """Return the sample with the most memory of a worker, of those around so many trials."""
    near = [sample for sample in samples if 0.8 * done <= sample[0] <= done] or [samples[-1]]
    return max(near, key=lambda sample: sample[2])


def nothing(row: Row) -> list[Row]:
    """Be a trial that takes no time."""
    return [row]


class EngineAlone(Experiment[Plan, Trial]):
    """The plan's trials without their trials."""

    def __init__(self, comparison: ControllerComparison, sample: Row) -> None:
        super().__init__(comparison.specification, comparison.request, comparison.columns)
        self._sample = sample

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        """See Experiment."""
        return ControllerComparison.read(path, quick)

    def cases(self, rows: Sequence[Row]) -> list[Trial]:
        """See Experiment."""
        return self.specification.cases(rows)

    def tasks(self, cases: Sequence[Trial]) -> Iterator[Task]:
        """See Experiment."""
        return (Task(case.id, nothing, (row_of(case, self._sample),), (case,)) for case in cases)

    def report(self, results: Results) -> Report:
        """See Experiment."""
        return Report([])


def row_of(trial: Trial, sample: Row) -> Row:
    """Return a trial's row with another one's results."""
    return {name: value for name, value in sample.items() if name not in PROVENANCE} | asdict(trial) | {"id": trial.id}


def run_engine(work: Path, size: int, sample: Row) -> dict[str, Any]:
    """Run so many tasks that do nothing, with two workers, through the runner, the scheduler and the store."""
    plan, out = work / f"engine-{size}.toml", work / f"engine-{size}"
    shutil.rmtree(out, ignore_errors=True)
    write_plan(plan, size)
    experiment = EngineAlone(comparison(plan, out), sample)
    most = {"runner_mb": 0.0, "worker_mb": 0.0}
    count, me = 0, psutil.Process()

    def kept() -> None:
        nonlocal count
        count += 1
        if count % max(1, size // 50) == 0:
            for name, value in resident_mb(me).items():
                most[name] = max(most[name], value)

    with local_workers(2) as client, Store(out, experiment.columns) as store:
        before = resident_mb(me)
        store.claim(experiment)
        began_s = time.perf_counter()
        Runner(experiment, store, client, Progress(out), kept).run()
        wall_s = time.perf_counter() - began_s
        assert len(store.rows()) == count
    shutil.rmtree(out)
    return {"tasks": count, "wall_s": wall_s, "before": before, **most}


def make_report(work: Path, size: int, samples: list[Row]) -> dict[str, Any]:
    """Make a report of so many rows."""
    plan, out = work / f"report-{size}.toml", work / f"report-{size}"
    shutil.rmtree(out, ignore_errors=True)
    write_plan(plan, size)
    experiment = comparison(plan, out)
    for name in (RECORDINGS, LOGS):
        (out / name).symlink_to(work / "trials" / name)
    cases = experiment.cases([])
    found = {(row["controller"], row["displacement_mm"]): row for row in samples}
    origin = {name: samples[0][name] for name in PROVENANCE}
    before_mb = psutil.Process().memory_info().rss / MB
    with Store(out, experiment.columns) as store:
        store.claim(experiment)
        store.note_invocation(len(cases), 1.0, 1.0, 2)
        store.add(*(row_of(case, found[str(case.controller), case.displacement_mm]) | origin for case in cases))
        began_s = time.perf_counter()
        rows = store.rows(experiment.cases(store.rows()))
        read_s = time.perf_counter() - began_s
        page = write_report(experiment.report(Results(rows, out)), experiment, store, rows)
    made = {
        "rows": len(rows), "read_s": read_s, "report_s": time.perf_counter() - began_s,
        "mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MB, "before_mb": before_mb,
        "page_mb": page.stat().st_size / MB, "database_mb": (out / DATABASE).stat().st_size / MB,
    }  # fmt: skip
    shutil.rmtree(out)
    return made


def table(figures: dict[str, Any]) -> str:
    """Return the table; what was not measured is computed from the nearest size that was, and set in italics."""
    trials = figures["trials"]
    head = "trials | 2 workers here | 4 machines x 16 workers | logs | runner's memory | report | its memory | its page"
    lines = [f"| {head} |", "|" + " ---: |" * 8]
    for size in SIZES:
        hours = size * trials["wall_s"] / trials["trials"] / 3600.0
        engine, factor = _nearest(figures["engine"], size)
        per_task_s = engine["wall_s"] / engine["tasks"]
        elsewhere = max(size * trials["task_s"] / 64.0, size * per_task_s) / 3600.0
        grown = engine["runner_mb"] + (engine["runner_mb"] - engine["before"]["runner_mb"]) * (factor - 1.0)
        report, more = _nearest(figures["report"], size)
        mb = report["mb"] + (report["mb"] - report["before_mb"]) * (more - 1.0)
        cells = [
            (f"{hours:.2g} h", size != trials["trials"]), (f"{elsewhere:.2g} h", True),
            (f"{size * trials['log_mb'] / 1e3:.3g} GB", size != trials["trials"]),
            (f"{grown:.0f} MB", factor != 1.0), (f"{report['report_s'] * more:.2g} s", more != 1.0),
            (f"{mb:.0f} MB", more != 1.0), (f"{report['page_mb'] * more:.2g} MB", more != 1.0),
        ]  # fmt: skip
        shown = " | ".join(f"*{text}*" if computed else text for text, computed in cells)
        lines.append(f"| {size:,} | {shown} |")
    return "\n".join(lines)


def _nearest(measured: dict[str, Any], size: int) -> tuple[dict[str, Any], float]:
    largest = max((int(each) for each in measured if int(each) <= size), default=min(map(int, measured)))
    return measured[str(largest)], size / largest


def main() -> int:
    """Measure what is missing, print the table; 1 where there was no time for all of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--engine", type=int, nargs="*", default=[100, 1_000, 10_000])
    parser.add_argument("--report", type=int, nargs="*", default=[100, 1_000, 10_000])
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--one-report", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    work: Path = chosen.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    kept = work / "growth.json"
    figures = json.loads(kept.read_text()) if kept.exists() else {"engine": {}, "report": {}}
    until_s = time.monotonic() + chosen.seconds
    if "trials" not in figures:
        trials = run_trials(work, chosen.trials, until_s)
        if trials is None:
            return 1
        figures["trials"] = trials
        kept.write_text(json.dumps(figures))
    experiment = comparison(work / "trials.toml", work / "trials")
    with Store(work / "trials", experiment.columns) as store:
        samples = store.rows()
    if chosen.one_report:
        print(json.dumps(make_report(work, chosen.one_report, samples)))
        return 0
    for name, sizes in (("engine", chosen.engine), ("report", chosen.report)):
        for size in sizes:
            if str(size) in figures[name]:
                continue
            if time.monotonic() > until_s:
                print(f"{name} of {size} is missing: the same command goes on", file=sys.stderr)
                return 1
            if name == "engine":
                figures[name][str(size)] = run_engine(work, size, samples[0])
            else:  # in a process of its own: its memory
                words = [sys.executable, "-m", "tests.programs.growth", str(work), "--one-report", str(size)]
                done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True, env=os.environ)
                figures[name][str(size)] = json.loads(done.stdout.splitlines()[-1])
            kept.write_text(json.dumps(figures))
    print(table(figures))
    trials = figures["trials"]
    pace = trials["robot_s"] / trials["wall_s"]
    print(f"\n{trials['trials']} trials in {trials['wall_s']:.0f} s, {pace:.1f} x real time")
    for done, runner_mb, worker_mb in trials["memory"]:
        print(f"after {done:.0f} trials: runner {runner_mb:.0f} MB, largest worker {worker_mb:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
