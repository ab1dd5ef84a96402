"""Runs what is missing of a study on the workers, keeps the rows of each batch as they come."""

import time
from collections.abc import Callable, Hashable, Sequence
from itertools import groupby
from typing import Protocol, TypeVar

from distributed import Client, Future

from rtstack.campaign.runner import RETRIES, Progress, finished, reason_of
from rtstack.campaign.store import Row, Store
from rtstack.studies.aim_aware.grid import Case, Grid
from rtstack.studies.planar.parameters import Task


class Timed(Protocol):
    """A study, as far as a runner needs it."""

    @property
    def task(self) -> Task: ...


class Run(Protocol):
    """A study that is run: which cases, and which of them together."""

    @property
    def study(self) -> Timed: ...
    @property
    def grid(self) -> Grid: ...
    @property
    def digest(self) -> str: ...
    def batch_of(self, case: Case) -> Hashable: ...


R = TypeVar("R", bound=Run)


def run_study(
    run: R, work: Callable[[R, Sequence[Case]], list[Row]], store: Store, client: Client, progress: Progress
) -> dict[str, str]:
    """Have `work` do what is missing, batch by batch; keep, report progress in cases. Returns what could not be run,
    with the reason."""
    done = {row["id"] for row in store.rows()}
    missing = [case for case in run.grid.cases() if case.id not in done]
    progress.begin("simulations", len(done), run.grid.size())
    futures: dict[Future, list[Case]] = {}
    for _, cases in groupby(missing, run.batch_of):
        batch = list(cases)
        key = f"{batch[0].id}-{run.digest}-{time.time_ns()}"  # no earlier run's result
        futures[client.submit(work, run, batch, key=key, retries=RETRIES, pure=False)] = batch
    failures: dict[str, str] = {}
    for future in finished(futures):
        batch = futures.pop(future)
        if future.status == "finished":
            store.add(*future.result())
        else:
            failures[f"{batch[0].id} and {len(batch) - 1} more"] = reason_of(future)
        for _ in batch:
            progress.advance(run.study.task.duration_s)
    return failures
