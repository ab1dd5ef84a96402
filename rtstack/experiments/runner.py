"""Runs a campaign: records its references, runs what is missing of its trials, keeps each result as it comes."""

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from distributed import Client, Future, as_completed

from rtstack.campaign.evaluation import NAMES
from rtstack.campaign.measures import measure
from rtstack.campaign.plan import Experiment, Plan
from rtstack.campaign.store import COLUMNS, Row, Store
from rtstack.campaign.trial import Reference, Trial, seed_of
from rtstack.campaign.trial_log import PARTIAL
from rtstack.campaign.worker import LOGS, RECORDINGS, Bench, record, run
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.review import log_columns

RETRIES = 2  # of a trial that could not be run: a full disk, a machine that went away


class Progress(Protocol):
    """Who is told how it goes."""

    def begin(self, label: str, done: int, total: int) -> None:
        """Say what is done from now on."""
        ...

    def advance(self, robot_s: float) -> None:
        """Say that one more is done, of so many seconds of the robot."""
        ...


@dataclass(slots=True)
class Tally:
    """What an invocation has done. failures: trials that could not be run, with the reason."""

    trials: int = 0
    robot_s: float = 0.0
    wall_s: float = 0.0
    began_s: float = 0.0
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def real_time_factor(self) -> float:
        """Robot's seconds over seconds, logs included."""
        return self.robot_s / self.wall_s if self.wall_s > 0.0 else 0.0

    def begin(self) -> None:
        """Count the wall's time from now on."""
        self.began_s = time.perf_counter()

    def keep(self, futures: dict[Future, Any], store: Store, progress: Progress) -> None:
        """Keep the row of each trial as it comes, and count it; one that could not be run, with its reason."""
        for future in finished(futures):
            trial = futures.pop(future)
            if future.status != "finished":
                self.failures[trial.id] = reason_of(future)
                progress.advance(0.0)
                continue
            row = future.result()
            store.add(row)
            robot_s = row["ticks"] * 1e-3
            self.trials += 1
            self.robot_s += robot_s
            self.wall_s = time.perf_counter() - self.began_s
            progress.advance(robot_s)


class Runner:
    """One invocation of a campaign."""

    def __init__(
        self, plan: Plan, bench: Bench, store: Store, client: Client, progress: Progress, description: CellDescription
    ) -> None:
        self._plan = plan
        self._bench = bench
        self._store = store
        self._client = client
        self._progress = progress
        self._description = description
        self.tally = Tally()

    def run(self) -> None:
        """Record, run, keep. Raises TrialError for a reference that cannot be recorded."""
        self._record()
        self.tally.begin()
        done = {row["id"] for row in self._store.rows()}
        self._progress.begin("trials", len(done), self._plan.size())
        logs = self._bench.archive.names(LOGS)
        for experiment in self._plan.experiments:
            trials = self._plan.trials(experiment, self.chosen(experiment))
            self._run_missing([trial for trial in trials if trial.id not in done and not self._adopt(trial, logs)])
        for name in self._bench.archive.names(LOGS):
            if name.endswith(PARTIAL):  # of a worker that was killed
                self._bench.archive.remove(f"{LOGS}/{name}")

    def chosen(self, experiment: Experiment) -> list[Reference]:
        """Return the references selected for an experiment: those that succeeded most often in the one before."""
        selection = experiment.selected
        if selection is None:
            return []
        before = next(e for e in self._plan.experiments if e.name == selection.experiment)
        rows = self._store.rows(self._plan.trials(before))
        return select([row for row in rows if row["controller"] in NAMES], selection.count)  # as the paper's four do

    def _record(self) -> None:
        """Record the references that are missing."""
        archive = self._bench.archive
        there = archive.names(RECORDINGS)
        missing = [reference for reference in self._plan.references() if reference.file not in there]
        if not missing:
            return
        self._progress.begin("references", 0, len(missing))
        conditions = next(iter(self._plan.conditions.values()))
        futures = {}
        for reference in missing:
            seed = seed_of(self._plan.seed, "reference", reference.name)
            key = f"reference-{reference.name}-{self._plan.digest}"
            futures[self._client.submit(record, self._bench, reference, conditions, seed, key=key, pure=False)] = (
                reference
            )
        for future in finished(futures):
            reason = reason_of(future) if future.status != "finished" else future.result()
            if reason is not None:
                reference = futures[future]
                archive.remove(f"{RECORDINGS}/{reference.file}")
                raise TrialError(f"the reference {reference.name} could not be recorded: {reason}")
            self._progress.advance(0.0)

    def _run_missing(self, trials: list[Trial]) -> None:
        futures: dict[Future, Trial] = {}
        for trial in trials:
            conditions = self._plan.conditions[trial.conditions]
            # no other invocation's result under this key: a scheduler may remember
            key = f"{trial.id}-{self._plan.digest}-{time.time_ns()}"
            submitted = self._client.submit(run, self._bench, trial, conditions, key=key, retries=RETRIES, pure=False)
            futures[submitted] = trial
        self.tally.keep(futures, self._store, self._progress)

    def _adopt(self, trial: Trial, logs: set[str]) -> bool:
        """Take the result of a trial that was run, and logged, before the program was killed. logs: those there are."""
        name = f"{trial.id}.mcap"
        if name not in logs:
            return False
        path = self._bench.archive.file(f"{LOGS}/{name}")
        row = row_of_log(path, trial, self._plan.digest, self._description)
        if row is None:
            return False
        self._store.add(row)
        self._progress.advance(0.0)
        return True


def select(rows: list[Row], count: int) -> list[Reference]:
    """Return the `count` references with the most successes, each kind in the order in which they come."""
    successes: dict[str, int] = {}
    for row in rows:
        successes[row["reference"]] = successes.get(row["reference"], 0) + bool(row["success"])
    best = sorted(successes, key=lambda name: -successes[name])[:count]
    return [Reference.named(name) for name in successes if name in best]


def row_of_log(path: Path, trial: Trial, digest: str, description: CellDescription) -> Row | None:
    """Return the row of a trial from its log alone, None where there is no complete log of this campaign."""
    try:
        log = read_log(path)
    except LogError:
        return None
    about, metadata, recorded = (log.metadata.get(name, {}) for name in ("campaign", "trial", "result"))
    if about.get("id") != trial.id or about.get("digest") != digest or not recorded:
        return None
    result = {name: _value(text, COLUMNS[name]) for name, text in recorded.items() if name in COLUMNS}
    measures = measure(
        log_columns(log), description, trial.object, trial.displacement_mm,
        result["nominal_impact_time_s"], result["detected_impact_time_s"],
    )  # fmt: skip
    values = {name: getattr(trial, name) for name in trial.__slots__}
    values |= result | {name: getattr(measures, name) for name in measures.__slots__}
    values |= {"id": trial.id, "controller": str(trial.controller), "log": f"{LOGS}/{path.name}", "digest": digest}
    return values | {"git_commit": metadata.get("git_commit", "unknown"), "wall_s": None, "worker": None}


def _value(text: str, kind: Any) -> Any:
    return text if kind is str else _loose(text)


def _loose(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text  # a reason in words


def finished(futures: Iterable[Future]) -> Iterator[Future]:
    """Yield futures as they end; cancel those that have not where the work is broken off."""
    waiting = list(futures)
    try:
        yield from as_completed(waiting)
    except BaseException:
        for future in waiting:
            future.cancel()
        raise


def reason_of(future: Future) -> str:
    """Return in one line why a future has no result."""
    error = future.exception() if future.status == "error" else None
    return " ".join(f"{type(error).__name__}: {error}".split()) if error is not None else str(future.status)
