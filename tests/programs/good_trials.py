"""Good trials have no intervention, and every limit in turn made reachable has one in each of them.

    .venv/bin/python -m tests.programs.good_trials [--trials 140] [--jobs 2] [--folder .good-trials]

Records grabs in the direct cell: all controllers, objects and displacements, each with a seed of its own, and a
demonstration of each object. Then judges every recording anew, alone: within the cell's limits, and with each limit
tightened to inside what the recording contains. Goes on where it was ended, from the recordings that are there; an
intervention while recording is in the log's own result, one while judging is found by judging.

Exit status 1 where a good trial has an intervention or a limit is not reached, 130 after Ctrl-C. A grab that failed
for another reason than the judge is no good trial; how many those are is printed.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.synchronize import Event
from pathlib import Path
from signal import SIG_IGN, SIGINT, SIGTERM, default_int_handler, signal
from threading import Thread
from typing import Any

import numpy as np

from rtstack.cells import default_cell_file, open_cell
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.safety.limits import HARDWARE
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.safety.judge_version import SUPPORT, digest
from tests.support.safety.reachable_limits import LIMITS, cases
from tests.support.safety.recorded_trial import Recorded, empty_places, furthest, judges_of, read_recorded, replay

DISPLACEMENTS_MM = (-30.0, 15.0, 0.0, -15.0, 30.0)
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Grab:
    """What to record; without a controller, a demonstration."""

    object: str
    controller: Controller | None = None
    displacement_mm: float = 0.0
    seed: int = 0

    @property
    def name(self) -> str:
        """Return what the recording is called."""
        if self.controller is None:
            return f"{self.object}-demonstration"
        return f"{self.object}-{self.controller}{self.displacement_mm:+.0f}mm-{self.seed}"


def grabs(cell: CellDescription, trials: int) -> Iterator[Grab]:
    """Yield the trials: displacements, controllers and objects in turn, so that any number of them has of all."""
    for seed in range(trials):
        row, k = divmod(seed, len(Controller) * len(DISPLACEMENTS_MM))
        controller = list(Controller)[k % len(Controller)]
        name = list(cell.objects)[(row + k) % len(cell.objects)]
        yield Grab(name, controller, DISPLACEMENTS_MM[k // len(Controller)], seed)


class Recorder:
    """What one of the processes side by side does: it records grabs, and judges what was recorded."""

    def __init__(self, folder: Path, ended: Event) -> None:
        """ended: that nobody wants the rest."""
        self._folder, self._ended = folder, ended
        self._cell = load_cell_description(default_cell_file())
        self._version = digest(SUPPORT / "recorded_trial.py", SUPPORT / "reachable_limits.py", default_cell_file())

    @property
    def stop_requested(self) -> bool:
        """Whether the trial that runs shall stop."""
        return self._ended.is_set()

    def examine(self, grab: Grab) -> dict[str, Any] | None:
        """Return what became of a grab: recorded and judged now, or known from earlier. None where it was ended."""
        log, notes = (self._folder / f"{grab.name}.{kind}" for kind in ("mcap", "json"))
        if notes.exists() and log.exists():
            known = json.loads(notes.read_text())
        else:
            known = self._record(grab, log)
        if self.stop_requested:
            return None
        if known.get("version") != self._version:
            if known["failed"] is None:
                known |= judged(read_recorded(log), self._cell)
            notes.write_text(json.dumps(known | {"version": self._version}))
        return known

    def _record(self, grab: Grab, log: Path) -> dict[str, Any]:
        part = log.with_suffix(".part.mcap")
        opened = open_cell("direct", grab.object, grab.displacement_mm * 1e-3, grab.seed)
        try:
            if grab.controller is None:
                specification = DemonstrationSpecification(grab.object)
                writing = open_log(part, specification, self._cell, "direct", default_cell_file(), overwrite=True)
                result = run_demonstration(specification, self._cell, opened, RunContext(writing, stop=self))
            else:
                reference = str(self._folder / f"{Grab(grab.object).name}.mcap")
                specification = TrialSpecification(
                    reference, grab.controller, grab.object, grab.displacement_mm, grab.seed
                )
                prepared = prepare_trial(specification, self._cell)
                writing = open_log(part, specification, self._cell, "direct", default_cell_file(), overwrite=True)
                result = run_trial(prepared, opened, RunContext(writing, stop=self))
        finally:
            opened.close()
        if self.stop_requested:
            part.unlink(missing_ok=True)
        else:
            part.replace(log)
        return {"failed": result.failure_reason, "interventions": result.safety_interventions}


def judged(trial: Recorded, cell: CellDescription) -> dict[str, Any]:
    """Judge a recording within the cell's limits, then with each limit in reach; return what came out."""
    stock, judges, places = HARDWARE.tightened(cell.safety), judges_of(cell), empty_places(trial)
    good = replay(trial, judges(stock), places)
    if good is not None:
        return {"again": f"{good.reason.text}, at tick {good.tick}", "ticks": good.tick, "cases": [], "furthest": {}}
    found = []
    for case in cases(trial, places, stock):
        seen = case.seen(judges)
        name, tick = (seen.reason.name, seen.tick) if seen else ("nothing", -1)
        found.append((case.limit, case.detail, name, tick, case.reached_by(seen)))
    return {"again": None, "ticks": trial.arms.shape[1], "cases": found, "furthest": furthest(trial, places)}


_recorder: Recorder | None = None


def _begin(folder: Path, ended: Event) -> None:
    global _recorder
    signal(SIGINT, SIG_IGN)  # Ctrl-C goes to all; the first process tells the others
    Thread(target=_end_with_the_first, daemon=True).start()
    os.nice(10)
    _recorder = Recorder(folder, ended)


def _end_with_the_first() -> None:
    first = parent_process()
    assert first is not None
    first.join()
    os._exit(1)


def _examine(grab: Grab) -> dict[str, Any] | None:
    assert _recorder is not None
    return _recorder.examine(grab)


def examine_all(all_grabs: list[Grab], folder: Path, jobs: int) -> dict[Grab, dict[str, Any]]:
    """Examine the demonstrations, then the trials, in processes side by side. Raises KeyboardInterrupt when ended."""
    context = get_context("spawn")
    ended, found, began = context.Event(), {}, time.monotonic()
    with ProcessPoolExecutor(jobs, context, _begin, (folder, ended)) as processes:
        try:
            for some in ([g for g in all_grabs if g.controller is None], [g for g in all_grabs if g.controller]):
                waiting = {processes.submit(_examine, grab): grab for grab in some}
                for future in as_completed(waiting):
                    grab, known = waiting[future], future.result()
                    found[grab] = known
                    left_s = (time.monotonic() - began) / len(found) * (len(all_grabs) - len(found))
                    said = known["failed"] or f"good, {len(known['cases'])} limits in reach"
                    print(f"{len(found)}/{len(all_grabs)}  {grab.name}: {said}; {left_s / 60:.0f} min left", flush=True)
        except BaseException:
            ended.set()
            processes.shutdown(cancel_futures=True)
            raise
    return found


def report(found: dict[Grab, dict[str, Any]]) -> int:
    """Print the table and the figures; return the exit status."""
    good = {grab: known for grab, known in found.items() if known["failed"] is None}
    cases_of: dict[str, list[tuple[str, int, bool]]] = {limit: [] for limit in LIMITS}
    bad = []
    for grab, known in found.items():
        if known["interventions"] or known.get("again"):
            bad.append(f"an intervention in {grab.name}: {known['failed'] or known['again']}")
        for limit, detail, name, tick, reached in known.get("cases", ()):
            cases_of[limit].append((name, tick, reached))
            if not reached:
                bad.append(f"not reached in {grab.name}: {limit} {detail}, {name}")
        for limit in set(LIMITS).difference(case[0] for case in known.get("cases", ())):
            if grab in good and not known["again"]:
                bad.append(f"nothing to reach in {grab.name}: {limit}")
    print(f"\n{'limit in reach':<34}{'trials':>7}{'replays':>9}{'intervened':>12}  reasons")
    for limit, seen in cases_of.items():
        trials = sum(any(case[0] == limit for case in known["cases"]) for known in good.values())
        reasons = ", ".join(f"{name.lower()} {n}" for name, n in Counter(name for name, _, _ in seen).most_common())
        print(f"{limit:<34}{trials:>7}{len(seen):>9}{sum(reached for _, _, reached in seen):>12}  {reasons}")
    for line in bad:
        print(line)
    print("\nthe furthest that good grabs go")
    for name in next((k["furthest"] for k in good.values() if k["cases"]), ()):
        lows, highs = np.moveaxis([known["furthest"][name] for known in good.values() if known["cases"]], 1, 0)
        low, high = (
            np.array2string(v, precision=3, suppress_small=True) for v in (lows.min(axis=0), highs.max(axis=0))
        )
        print(f"{name:<34}{low} to {high}")
    trials = [grab for grab in good if grab.controller is not None]
    interventions = sum(known["interventions"] + bool(known.get("again")) for known in found.values())
    of = {f"{len(set(values))} {what}" for what, values in (
        ("controllers", (g.controller for g in trials)), ("objects", (g.object for g in trials)),
        ("displacements", (g.displacement_mm for g in trials)))}  # fmt: skip
    print(f"{interventions} interventions in {len(trials)} good trials ({', '.join(sorted(of))}) and "
          f"{len(good) - len(trials)} demonstrations, {sum(known['ticks'] for known in good.values())} ticks; "
          f"{len(found) - len(good)} grabs failed{':' if len(good) < len(found) else ''}")  # fmt: skip
    for grab, known in found.items():
        if known["failed"]:
            print(f"  {grab.name}: {known['failed']}")
    return 1 if bad else 0


def main() -> int:
    """Record and judge; return the exit status."""
    arguments = argparse.ArgumentParser(description="Good trials, and every limit of the judge in reach of them.")
    arguments.add_argument("--trials", type=int, default=140)
    arguments.add_argument("--jobs", type=int, default=os.cpu_count())
    arguments.add_argument("--folder", type=Path, default=ROOT / ".good-trials")
    options = arguments.parse_args()
    for number in (SIGINT, SIGTERM):
        signal(number, default_int_handler)
    options.folder.mkdir(exist_ok=True)
    (options.folder / ".gitignore").write_text("*\n")
    trials = list(grabs(load_cell_description(default_cell_file()), options.trials))
    demonstrations = [Grab(name) for name in dict.fromkeys(grab.object for grab in trials)]
    try:
        found = examine_all([*demonstrations, *trials], options.folder, options.jobs)
    except KeyboardInterrupt:
        print("ended; the next run goes on from here")
        return 130
    return report(found)


if __name__ == "__main__":
    sys.exit(main())
