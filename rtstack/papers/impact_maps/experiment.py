"""The validation of impact maps as a kind of experiment: friction, references, what is left along them, trials."""

from collections.abc import Generator, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rtstack.experiments.experiment import SIMULATED, CellRun, Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.report import Report
from rtstack.experiments.store import columns_of
from rtstack.papers.conditions import LOGS, RECORDINGS
from rtstack.papers.impact_maps.plan import (
    SWEEPS,
    FreeRuns,
    PlannedReference,
    ValidationPlan,
    ValidationTrial,
    load_validation_plan,
)
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.log.reader import Log


class Validation(Experiment[ValidationPlan, ValidationTrial]):
    """Sections V and VI of the impact-map paper. Trials of a reference that is refused are left out, and reported."""

    options = frozenset({"cell", "cell_file"})
    made = ("references", "identification")
    on_stack = False

    def __init__(self, specification: ValidationPlan, request: Request) -> None:
        from rtstack.cells import load_description
        from rtstack.papers.impact_maps.worker import MEASURED, ValidationBench
        from rtstack.papers.simulated_cell import plant_files
        from rtstack.trials.object import check_object
        from rtstack.trials.result import TrialResult

        self.description, cell_file = load_description(request.cell_file)
        for thing in specification.objects:
            check_object(thing, self.description)
        on_arms, sources = request.cell not in SIMULATED, [cell_file, *plant_files()]
        if on_arms:
            specification = specification.on_arms()
            friction = self.description.joint_friction
            if specification.free_runs() and friction is None:
                raise TrialError(
                    f"{cell_file} has no joint_friction, with which the plan's trials are run: identify it first "
                    "(rtstack identify-friction), or set joint_friction in the plan's conditions"
                )
            sources += [] if friction is None else [friction]
        super().__init__(specification, request, columns_of(ValidationTrial, TrialResult) | MEASURED, sources)
        nominal = next(iter(specification.conditions.values()))
        self._bench = ValidationBench(
            request.out, request.simulated_cell, cell_file, self.digest, nominal, on_arms, request.cell_file
        )
        self.refused: dict[PlannedReference, str] = {}

    @classmethod
    def read(cls, path: Path, quick: bool) -> ValidationPlan:
        return load_validation_plan(path, quick)

    def size(self) -> int:
        return len(self.cases(()))

    def stages(self) -> Stages:
        """Identify friction, then what is left along each reference, then plan. Raises TrialError without friction."""
        for name in (SWEEPS, RECORDINGS, LOGS):
            (self.request.out / name).mkdir(exist_ok=True)
        if not self._bench.on_arms:
            yield from self._identify()
        not_identified = yield from self._identify_along()
        yield from self._plan_references(not_identified)

    def _identify(self) -> Stages:
        """Make the runs of Appendix A that are missing, and for each robot the file that its controller reads."""
        from rtstack.identification.procedure import Identification, lowest_object, runs_of
        from rtstack.papers.impact_maps.worker import friction_file, identify, sweep_file
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
        from rtstack.papers.impact_maps.worker import identify_along

        plan, folder = self.specification, self.request.out / SWEEPS
        missing = {one.file: one for one in plan.free_runs() if not (folder / one.file).exists()}
        without: dict[FreeRuns, str] = {}
        if self._bench.on_arms:
            without = yield from self._run_free(missing.values())
            missing = {file: one for file, one in missing.items() if one not in without}
        failed = yield Stage("identification along the references", [
            Task(file, identify_along, (self._bench, one, plan.scenario(one.motion), plan.identification_runs))
            for file, one in missing.items()
        ])  # fmt: skip
        return without | {missing[file]: reason for file, reason in failed.items()}

    def _run_free(self, missing: Iterable[FreeRuns]) -> Generator[Stage, dict[str, str], dict[FreeRuns, str]]:
        """Have the arms make the runs that have no log yet. Returns why, of those that cannot be made."""
        from rtstack.papers.impact_maps.worker import free_run_on_arms, identify_along
        from rtstack.trials.review import has_succeeded

        plan, folder = self.specification, self.request.out / SWEEPS
        asked = {
            one.log(run): (self._bench, one, plan.scenario(one.motion), run)
            for one in missing for run in range(plan.identification_runs)
            if not has_succeeded(folder / one.log(run))
        }  # fmt: skip
        tasks = [Task(log, identify_along, each) for log, each in asked.items()]
        failed = yield Stage("runs along the references", tasks, lambda log: free_run_on_arms(*asked[log]))
        return {asked[log][1]: reason for log, reason in failed.items()}

    def _plan_references(self, not_identified: dict[FreeRuns, str]) -> Stages:
        """Plan what is missing; a reference along which nothing could be identified is refused, too."""
        from rtstack.papers.impact_maps.worker import plan_reference

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
        plan = self.specification
        return [trial for trial in plan.trials() if plan.reference(trial) not in self.refused]

    def tasks(self, cases: Sequence[ValidationTrial]) -> Iterable[Task]:
        from rtstack.papers.impact_maps.worker import run

        for trial in cases:
            yield Task(trial.id, run, (self._bench, trial, self.specification.setting(trial)), (trial,))

    def on_cell(self, case: ValidationTrial) -> CellRun:
        from rtstack.papers.impact_maps.worker import on_arms

        return on_arms(self._bench, case, self.specification.setting(case))

    def row_of_log(self, case: ValidationTrial, log: "Log") -> Row:
        from rtstack.papers.impact_maps.worker import row_of_log

        return row_of_log(self._bench, case, self.specification.setting(case), log, self.columns)

    def report(self, results: Results) -> Report:
        from rtstack.papers.impact_maps.report import report

        return report(self.specification, self.description, results, self.refused)
