"""Runs a validation campaign: friction first, then the references, then what is missing of the trials."""

import time
from collections.abc import Callable, Iterable
from typing import Any

from distributed import Client

from rtstack.campaign.runner import RETRIES, Progress, Tally, finished, reason_of
from rtstack.campaign.store import Store
from rtstack.campaign.worker import LOGS, RECORDINGS
from rtstack.identification.procedure import Identification, lowest_object, runs_of
from rtstack.impact_validation.plan import ValidationPlan
from rtstack.impact_validation.worker import FRICTION, SWEEPS, ValidationBench, identify, plan_reference, run
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import friction_toml


class ValidationRunner:
    """One invocation of a campaign."""

    def __init__(
        self, plan: ValidationPlan, bench: ValidationBench, store: Store, client: Client, progress: Progress,
        description: CellDescription,
    ) -> None:  # fmt: skip
        self._plan = plan
        self._bench = bench
        self._store = store
        self._client = client
        self._progress = progress
        self._description = description
        self.tally = Tally()

    def run(self) -> None:
        """Identify, plan, run, keep. Raises TrialError where friction or a reference cannot be had."""
        for name in (SWEEPS, RECORDINGS, LOGS):
            (self._bench.out / name).mkdir(exist_ok=True)
        self._identify()
        self._plan_references()
        self._run_missing()

    def _identify(self) -> None:
        """Make the runs of Appendix A that are missing, and the file that the controller reads."""
        path = self._bench.out / FRICTION
        if path.exists():
            return
        runs = list(runs_of(lowest_object(self._description), self._plan.identification_runs, self._plan.robot))
        logs = self._bench.out / SWEEPS
        missing = [one for one in runs if not (logs / one.file).exists()]
        self._submit_all("friction identification", missing, identify, lambda one: (one,), lambda one: one.file)
        identification = Identification(self._description)
        for one in runs:
            if not identification.take_log(one, logs / one.file):
                raise TrialError(f"{logs / one.file} is no complete log: remove it, and go on with --resume")
        path.write_text(friction_toml(identification.file(self._description.name, self._plan.robot)), encoding="utf-8")

    def _plan_references(self) -> None:
        folder = self._bench.out / RECORDINGS
        missing = [one for one in self._plan.references() if not (folder / one.file).exists()]
        self._submit_all(
            "references", missing, plan_reference, lambda one: (one, self._plan.scenario(one.motion)),
            lambda one: one.file,
        )  # fmt: skip

    def _submit_all(
        self, label: str, work: list[Any], task: Callable[..., str | None],
        arguments: Callable[[Any], Iterable[Any]], name: Callable[[Any], str],
    ) -> None:  # fmt: skip
        """Have all of `work` done. Raises TrialError with the first reason why something was not."""
        if not work:
            return
        self._progress.begin(label, 0, len(work))
        futures = {
            self._client.submit(
                task, self._bench, *arguments(one), key=f"{name(one)}-{time.time_ns()}", pure=False
            ): one
            for one in work
        }
        for future in finished(futures):
            reason = reason_of(future) if future.status != "finished" else future.result()
            if reason is not None:
                raise TrialError(f"{label}: {name(futures[future])}: {reason}")
            self._progress.advance(0.0)

    def _run_missing(self) -> None:
        began_s = time.perf_counter()
        done = {row["id"] for row in self._store.rows()}
        trials = [trial for trial in self._plan.trials() if trial.id not in done]
        self._progress.begin("trials", len(done), self._plan.size())
        futures = {}
        for trial in trials:
            gains = self._plan.scenario(trial.motion).gains
            # no other invocation's result under this key: a scheduler may remember
            key = f"{trial.id}-{self._plan.digest}-{time.time_ns()}"
            future = self._client.submit(
                run, self._bench, trial, self._plan.reference(trial), gains, self._plan.conditions[trial.conditions],
                key=key, retries=RETRIES, pure=False,
            )  # fmt: skip
            futures[future] = trial
        for future in finished(futures):
            trial = futures.pop(future)
            if future.status != "finished":
                self.tally.failures[trial.id] = reason_of(future)
                self._progress.advance(0.0)
                continue
            row = future.result()
            self._store.add(row)
            self.tally.trials += 1
            self.tally.robot_s += row["ticks"] * 1e-3
            self.tally.wall_s = time.perf_counter() - began_s
            self._progress.advance(row["ticks"] * 1e-3)
