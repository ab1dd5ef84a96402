"""The validation of impact maps as a kind of experiment: friction first, then references and what is left of friction
along them, then trials.
"""

from collections.abc import Generator, Iterable, Sequence
from pathlib import Path

from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.report import Report
from rtstack.experiments.store import columns_of
from rtstack.papers.impact_maps.plan import (
    FreeRuns,
    PlannedReference,
    ValidationPlan,
    ValidationTrial,
    load_validation_plan,
)
from rtstack.trials.errors import TrialError


class Validation(Experiment[ValidationPlan, ValidationTrial]):
    """Sections V and VI of the impact-map paper. Trials of a reference that is refused are left out, and reported."""

    options = frozenset({"cell"})

    def __init__(self, specification: ValidationPlan, request: Request) -> None:
        from rtstack.cells import load_description
        from rtstack.papers.impact_maps.worker import MEASURED, ValidationBench
        from rtstack.papers.simulated_cell import plant_files
        from rtstack.trials.object import check_object
        from rtstack.trials.result import TrialResult

        self.description, cell_file = load_description(None)
        for thing in specification.objects:
            check_object(thing, self.description)
        columns = columns_of(ValidationTrial, TrialResult) | MEASURED
        super().__init__(specification, request, columns, [cell_file, *plant_files()])
        nominal = next(iter(specification.conditions.values()))
        self._bench = ValidationBench(request.out, request.simulated_cell, cell_file, self.digest, nominal)
        self.refused: dict[PlannedReference, str] = {}

    @classmethod
    def read(cls, path: Path, quick: bool) -> ValidationPlan:
        """See Experiment."""
        return load_validation_plan(path, quick)

    def size(self) -> int:
        """Return how many trials have a reference."""
        return len(self.cases(()))

    def stages(self) -> Stages:
        """Identify friction, then what is left along each reference, then plan. Raises TrialError without friction."""
        from rtstack.papers.demonstrations import LOGS, RECORDINGS
        from rtstack.papers.impact_maps.worker import SWEEPS

        for name in (SWEEPS, RECORDINGS, LOGS):
            (self.request.out / name).mkdir(exist_ok=True)
        yield from self._identify()
        not_identified = yield from self._identify_along()
        yield from self._plan_references(not_identified)

    def _identify(self) -> Stages:
        """Make the runs of Appendix A that are missing, and for each robot the file that its controller reads."""
        from rtstack.identification.procedure import Identification, lowest_object, runs_of
        from rtstack.papers.impact_maps.worker import SWEEPS, friction_file, identify, sweep_file
        from rtstack.trials.friction import friction_toml

        plan, out = self.specification, self.request.out
        of_robot = {
            robot: list(runs_of(lowest_object(self.description), plan.identification_runs, robot))
            for robot in plan.robots
            if not (out / friction_file(robot)).exists()
        }
        tasks = [
            Task(sweep_file(robot, one), identify, (self._bench, robot, one))
            for robot, runs in of_robot.items()
            for one in runs
            if not (out / SWEEPS / sweep_file(robot, one)).exists()
        ]
        failed = yield Stage("friction identification", tasks)
        for file, reason in failed.items():
            raise TrialError(f"friction identification: {file}: {reason}")
        for robot, runs in of_robot.items():
            identification = Identification(self.description)
            for one in runs:
                log = out / SWEEPS / sweep_file(robot, one)
                if not identification.take_log(one, log):
                    raise TrialError(f"{log} is no complete log: remove it, and go on with --resume")
            text = friction_toml(identification.file(self.description.name, robot))
            (out / friction_file(robot)).write_text(text, encoding="utf-8")

    def _identify_along(self) -> Generator[Stage, dict[str, str], dict[FreeRuns, str]]:
        """Make what is missing of the runs along the references; return what could not be made, and why."""
        from rtstack.papers.impact_maps.reference import identify_along
        from rtstack.papers.impact_maps.worker import SWEEPS

        plan, folder = self.specification, self.request.out / SWEEPS
        missing = {one.file: one for one in plan.free_runs() if not (folder / one.file).exists()}
        failed = yield Stage("identification along the references", [
            Task(file, identify_along, (self._bench, one, plan.scenario(one.motion), plan.identification_runs))
            for file, one in missing.items()
        ])  # fmt: skip
        return {missing[file]: reason for file, reason in failed.items()}

    def _plan_references(self, not_identified: dict[FreeRuns, str]) -> Stages:
        """Plan what is missing; a reference along which nothing could be identified is refused, too."""
        from rtstack.papers.demonstrations import RECORDINGS
        from rtstack.papers.impact_maps.reference import plan_reference

        plan, folder = self.specification, self.request.out / RECORDINGS
        self.refused = {
            one: not_identified[runs]
            for one in plan.references() for runs in one.free_runs if runs in not_identified
        }  # fmt: skip
        missing = {
            one.file: one for one in plan.references() if one not in self.refused and not (folder / one.file).exists()
        }
        failed = yield Stage("references", [
            Task(file, plan_reference, (self._bench, one, plan.scenario(one.motion))) for file, one in missing.items()
        ])  # fmt: skip
        self.refused |= {missing[file]: reason for file, reason in failed.items()}

    def cases(self, rows: Sequence[Row]) -> list[ValidationTrial]:
        """Return the trials whose reference is not refused."""
        plan = self.specification
        return [trial for trial in plan.trials() if plan.reference(trial) not in self.refused]

    def tasks(self, cases: Sequence[ValidationTrial]) -> Iterable[Task]:
        """Return a task for each trial."""
        from rtstack.papers.impact_maps.worker import run

        plan = self.specification
        for trial in cases:
            gains, conditions = plan.scenario(trial.motion).gains, plan.conditions[trial.conditions]
            yield Task(trial.id, run, (self._bench, trial, plan.reference(trial), gains, conditions), (trial,))

    def report(self, results: Results) -> Report:
        """See rtstack.papers.impact_maps.report."""
        from rtstack.papers.impact_maps.report import report

        return report(self.specification, self.description, results, self.refused)
