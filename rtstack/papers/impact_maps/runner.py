"""Runs a validation campaign: friction first, then the references and what is left of friction along them, then what is
missing of the trials."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from distributed import Client

from rtstack.campaign.runner import RETRIES, Progress, Tally, finished, reason_of
from rtstack.campaign.store import Store
from rtstack.campaign.worker import LOGS, RECORDINGS
from rtstack.identification.procedure import Identification, Run, lowest_object, runs_of
from rtstack.impact_validation.plan import FreeRuns, PlannedReference, ValidationPlan
from rtstack.impact_validation.reference import identify_along, plan_reference
from rtstack.impact_validation.worker import FRICTION, SWEEPS, ValidationBench, identify, run
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import friction_toml

Work = TypeVar("Work", Run, PlannedReference, FreeRuns)


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
        self.refused: dict[PlannedReference, str] = {}

    def run(self) -> None:
        """Identify, plan, run, keep. Trials of a reference that is refused are left out, and it is in `refused`.

        Raises TrialError where friction cannot be had.
        """
        for name in (SWEEPS, RECORDINGS, LOGS):
            (self._bench.out / name).mkdir(exist_ok=True)
        self._identify()
        along = self._identify_along()
        self._plan_references(along)
        self._run_missing()

    def _identify(self) -> None:
        """Make the runs of Appendix A that are missing, and the file that the controller reads."""
        path = self._bench.out / FRICTION
        if path.exists():
            return
        runs = list(runs_of(lowest_object(self._description), self._plan.identification_runs, self._plan.robot))
        logs = self._bench.out / SWEEPS
        missing = [one for one in runs if not (logs / one.file).exists()]
        failed = self._submit_all("friction identification", missing, identify, lambda one: (one,))
        for one, reason in failed.items():
            raise TrialError(f"friction identification: {one.file}: {reason}")
        identification = Identification(self._description)
        for one in runs:
            if not identification.take_log(one, logs / one.file):
                raise TrialError(f"{logs / one.file} is no complete log: remove it, and go on with --resume")
        path.write_text(friction_toml(identification.file(self._description.name, self._plan.robot)), encoding="utf-8")

    def _identify_along(self) -> dict[FreeRuns, str]:
        """Make what is missing of the runs along the references. Returns what could not be made, and why."""
        folder, count = self._bench.out / SWEEPS, self._plan.identification_runs
        missing = [one for one in self._plan.free_runs() if not (folder / one.file).exists()]
        return self._submit_all(
            "identification along the references", missing, identify_along,
            lambda one: (one, self._plan.scenario(one.motion), count),
        )  # fmt: skip

    def _plan_references(self, not_identified: Mapping[FreeRuns, str]) -> None:
        """Plan what is missing; a reference along which nothing could be identified is refused, too."""
        folder = self._bench.out / RECORDINGS
        refused = {
            one: not_identified[runs]
            for one in self._plan.references() for runs in one.free_runs if runs in not_identified
        }  # fmt: skip
        missing = [one for one in self._plan.references() if one not in refused and not (folder / one.file).exists()]
        self.refused = refused | self._submit_all(
            "references", missing, plan_reference, lambda one: (one, self._plan.scenario(one.motion))
        )

    def _submit_all(
        self, label: str, work: list[Work], task: Callable[..., str | None], arguments: Callable[[Work], Iterable[Any]]
    ) -> dict[Work, str]:
        """Have all of `work` done. Returns what could not be, and why; raises TrialError where a worker broke."""
        if not work:
            return {}
        self._progress.begin(label, 0, len(work))
        futures = {
            self._client.submit(task, self._bench, *arguments(one), key=f"{one.file}-{time.time_ns()}", pure=False): one
            for one in work
        }
        failed: dict[Work, str] = {}
        for future in finished(futures):
            one = futures[future]
            if future.status != "finished":
                raise TrialError(f"{label}: {one.file}: {reason_of(future)}")
            reason = future.result()
            if reason is not None:
                failed[one] = reason
            self._progress.advance(0.0)
        return failed

    def _run_missing(self) -> None:
        self.tally.begin()
        done = {row["id"] for row in self._store.rows()}
        possible = [trial for trial in self._plan.trials() if self._plan.reference(trial) not in self.refused]
        trials = [trial for trial in possible if trial.id not in done]
        self._progress.begin("trials", len(done), len(possible))
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
        self.tally.keep(futures, self._store, self._progress)
