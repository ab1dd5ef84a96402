"""Runs a campaign: what its cases need, then what is missing of its cases; keeps the rows of each task as they come."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from types import TracebackType
from typing import Any, cast

from distributed import Client, Future, as_completed

from hal.extensions import raised
from rtstack.experiments.experiment import Case, Experiment, Row, Stage, Task
from rtstack.experiments.progress import Progress
from rtstack.experiments.simulation import simulated_tasks
from rtstack.experiments.store import Store
from rtstack.experiments.task import run_cases, run_stage
from rtstack.experiments.workers import slots
from rtstack.trials.errors import TrialError

RETRIES = 2  # of a task that could not be run: a full disk, a machine that went away
# tasks a worker that are submitted at a time: the scheduler remembers each one, and its result, as long as we do
AHEAD = 16


@dataclass(slots=True)
class Tally:
    """What an invocation has done. failures: tasks that could not be run, with the reason."""

    rows: int = 0
    robot_s: float = 0.0
    wall_s: float = 0.0
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def real_time_factor(self) -> float:
        return self.robot_s / self.wall_s if self.wall_s > 0.0 else 0.0


class Runner:
    """One invocation of a campaign. kept: called after each task whose rows were kept."""

    def __init__(
        self, experiment: Experiment[Any, Any], store: Store, client: Client, progress: Progress,
        kept: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        self._experiment = experiment
        self._store = store
        self._client = client
        self._progress = progress
        self._kept = kept
        self.tally = Tally()

    def run(self) -> None:
        """Prepare, run, keep. Raises TrialError where the cases cannot be run."""
        stages, failed = self._experiment.stages(), cast("dict[str, str]", None)  # a generator begins with None
        with suppress(StopIteration):
            while True:
                failed = self._prepare(stages.send(failed))
        began_s = time.perf_counter()
        done = {row["id"] for row in self._store.rows()}
        self._progress.begin(self._experiment.unit, len(done), self._experiment.size())
        tried: set[str] = set()
        while missing := [case for case in self._experiment.cases(self._store.rows()) if case.id not in done | tried]:
            tried |= {case.id for case in missing}
            adopted = self._adopt(missing)
            self._run([case for case in missing if case.id not in adopted], began_s)
        self._experiment.tidy()

    def _prepare(self, stage: Stage) -> dict[str, str]:
        """Do all tasks of a stage. Returns which of them failed, and why. Raises TrialError where a worker broke."""
        if not stage.tasks:
            return {}
        self._progress.begin(stage.label, 0, len(stage.tasks))
        sources = self._experiment.sources
        failed: dict[str, str] = {}
        for task, future in self._finished(
            stage.tasks, lambda task: self._submit(task, run_stage, task.function, task.arguments, sources, retries=0)
        ):
            if future.status != "finished":
                raise TrialError(f"{stage.label}: {task.name}: {_reason_of(future, task.function)}")
            reason = future.result()
            if reason is not None:
                failed[task.name] = reason
            self._progress.advance()
        return failed

    def _adopt(self, cases: list[Case]) -> set[str]:
        """Take rows of cases that were run, and logged, before the program was killed. Returns their ids."""
        return {self._keep(row) for row in self._experiment.adopt(cases)}

    def _keep(self, row: Row) -> str:
        """Keep a row that a log has. Returns its case's id."""
        self._store.add(row)
        self._progress.advance()
        return row["id"]

    def _run(self, cases: list[Case], began_s: float) -> None:
        experiment, tally = self._experiment, self.tally
        for task, future in self._finished(
            [*experiment.tasks(cases)] or simulated_tasks(experiment, cases),
            lambda task: self._submit(
                task, run_cases, task.function, task.arguments, experiment.sources, experiment.digest, retries=RETRIES
            ),
        ):
            if future.status != "finished":
                tally.failures[_words(task)] = _reason_of(future, task.function, experiment.row_of_log)
                self._progress.advance(failed=len(task.cases), done=0)
                continue
            rows: list[Row] = future.result()
            try:
                self._store.add(*rows, made_by=(task.function, experiment.row_of_log))
            except TrialError as error:
                tally.failures[_words(task)] = str(error)
                self._progress.advance(failed=len(task.cases), done=0)
                continue
            robot_s = sum(map(experiment.robot_s, rows))
            tally.rows += len(rows)
            tally.robot_s += robot_s
            tally.wall_s = time.perf_counter() - began_s
            self._progress.advance(robot_s, done=len(rows))
            self._kept()

    def _submit(self, task: Task, function: Callable[..., Any], *arguments: Any, retries: int) -> Future:
        # a scheduler may remember: no other invocation's result comes under this key; and it keeps statistics of each
        # first word, as its workers do, for good
        key = ("task", f"{task.name}-{self._experiment.digest}-{time.time_ns()}")
        return self._client.submit(function, *arguments, key=key, retries=retries, pure=False)

    def _finished(self, tasks: Iterable[Task], submit: Callable[[Task], Future]) -> Iterator[tuple[Task, Future]]:
        """Yield tasks as they end, AHEAD of a worker submitted at a time; cancel them where the work is broken off."""
        missing, running, ended = iter(tasks), dict[Future, Task](), as_completed()

        def fill() -> int:
            most = AHEAD * max(1, slots(self._client))  # workers join and leave
            for task in islice(missing, max(0, most - len(running))):
                future = submit(task)
                running[future] = task
                ended.add(future)
            return most // 2

        try:
            few = fill()
            for future in ended:
                yield running.pop(future), future
                if len(running) < few:
                    few = fill()
        except BaseException:
            for future in running:
                future.cancel()
            raise


def _words(task: Task) -> str:
    further = len(task.cases) - 1
    return f"{task.cases[0].id} and {further} more" if further > 0 else task.name


def _reason_of(future: Future, *called: object) -> str:
    """Return in one line why a task has failed. called: the functions of another author that it calls."""
    error = future.exception() if future.status == "error" else None
    if not isinstance(error, BaseException):
        return str(future.status)
    return raised(error.with_traceback(cast("TracebackType", future.traceback())), *called)
