"""The comparison of controllers as a kind of experiment: references are recorded, trials run and logged, compared."""

import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hal.base.configuration import toml_text
from hal.base.files import PARTIAL
from rtstack.experiments.experiment import SIMULATED, CellRun, Experiment, Request, Results, Row, Stages, Task
from rtstack.experiments.registry import plan_file
from rtstack.experiments.report import Report
from rtstack.experiments.store import columns_of
from rtstack.papers.conditions import LOGS
from rtstack.papers.reference_spreading.plan import Plan, Trial, load_plan
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.log.reader import Log

PATTERN = "reference-spreading"  # the plan whose conditions and criterion of success a comparison takes
_MADE = "made on the page Campaigns; the conditions and what a success is are those of the plan"


def comparison_plan(
    name: str, title: str, controllers: Sequence[str], objects: Sequence[str], demonstrations: int,
    displacements_mm: Sequence[float], repetitions: int, seed: int,
) -> str:  # fmt: skip
    """Return a plan's file: controllers x demonstrations of objects x displacements x repetitions. Raises OSError."""
    taken = tomllib.loads(plan_file(PATTERN).path.read_text(encoding="utf-8"))
    first = next(iter(taken["conditions"].items()))
    head = {
        "name": name, "title": title, "seed": seed, "controllers": list(controllers), "success": taken["success"],
        "conditions": dict([first]),
    }  # fmt: skip
    references = [f"{thing}/{number}" for thing in objects for number in range(demonstrations)]
    experiment = {
        "name": "comparison", "references": references, "displacements_mm": list(displacements_mm),
        "repetitions": repetitions, "conditions": [first[0]],
    }  # fmt: skip
    sample = {"references": 1, "displacements_mm": list(displacements_mm[:2]), "repetitions": 1}
    parts = [toml_text(head, f"{_MADE} {taken['name']}"), "[[experiments]]", toml_text(experiment)]
    return "\n".join([*parts, "[experiments.quick]", toml_text(sample)])


class ControllerComparison(Experiment[Plan, Trial]):
    """Controllers x references x displacements, under one or more sets of conditions: the campaign of the
    reference-spreading paper, and any plan of this form.
    """

    options = frozenset({"cell", "logs", "cell_file", "profile"})
    made = ("references",)

    def __init__(self, specification: Plan, request: Request) -> None:
        from rtstack.cells import load_description
        from rtstack.cells.simulated import plant_difference
        from rtstack.papers.demonstrations import Bench
        from rtstack.papers.reference_spreading.measures import Measures
        from rtstack.papers.simulated_cell import plant_files
        from rtstack.trials.object import check_object
        from rtstack.trials.result import TrialResult

        used = {name for each in specification.experiments for name in each.conditions}
        plants = {specification.conditions[name].plant for name in used}
        if request.cell not in SIMULATED and len(plants) > 1:
            raise TrialError(
                f"{specification.name} compares conditions that arms cannot be given, such as friction or profile: on "
                "arms give a plan whose conditions differ in law_inertia, detector, hand or speed_m_s"
            )
        if request.profile is not None:
            specification = specification.under(request.profile)
        lab_file = request.cell_file
        if lab_file is None and specification.cell_file is not None:
            lab_file = (request.file.path.parent / specification.cell_file).resolve()
        description, cell_file = load_description(lab_file)
        for thing in dict.fromkeys(reference.object for reference in specification.references()):
            check_object(thing, description)
            if other := plant_difference(lab_file, thing):
                print(f"rtstack: warning: {other}", file=sys.stderr)
        sources = [cell_file, *plant_files(specification.conditions.values())]
        super().__init__(specification, request, columns_of(Trial, TrialResult, Measures), sources)
        self._bench = Bench(
            request.out, request.simulated_cell, cell_file, self.digest, specification.criterion, request.logs, lab_file
        )
        self._bench.archive.check()
        self._unrecorded: dict[str, str] = {}  # name of a reference -> why there is none

    @classmethod
    def composed(cls, values: Mapping[str, Any]) -> str:
        """Return a plan with the conditions of the paper's; values: the parameters of `comparison_plan`."""
        return comparison_plan(**values)

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        return load_plan(path, quick)

    def stages(self) -> Stages:
        """Record the references that are missing, without which trials are left out. Raises TrialError without any."""
        from rtstack.papers.demonstrations import recording_stages

        plan = self.specification
        references = plan.references()
        self._unrecorded = yield from recording_stages(self._bench, references, plan.conditions_of, plan.seed)
        if len(self._unrecorded) == len(references):
            name, reason = next(iter(self._unrecorded.items()))
            raise TrialError(f"the reference {name} could not be recorded: {reason}")

    def size(self) -> int:
        plan = self.specification
        trials = [trial for each in plan.experiments for trial in plan.trials(each)]
        return plan.size() - sum(trial.reference in self._unrecorded for trial in trials)

    def cases(self, rows: Sequence[Row]) -> list[Trial]:
        return self.specification.cases(rows, self._unrecorded)

    def adopt(self, cases: Sequence[Trial]) -> Iterable[Row]:
        """Take the rows of trials from their logs, which are the truth."""
        from rtstack.experiments.case_log import row_of

        archive = self._bench.archive
        logs = archive.names(LOGS)
        for case in cases:
            name = f"{case.id}.mcap"
            if name in logs and (row := row_of(self, case, archive.file(f"{LOGS}/{name}"))):
                yield row

    def tasks(self, cases: Sequence[Trial]) -> Iterable[Task]:
        from rtstack.papers.reference_spreading.worker import run

        conditions = self.specification.conditions
        return [Task(each.id, run, (self._bench, each, conditions[each.conditions]), (each,)) for each in cases]

    def on_cell(self, case: Trial) -> CellRun:
        from rtstack.papers.reference_spreading.worker import on_arms

        return on_arms(self._bench, case, self.specification.conditions[case.conditions])

    def row_of_log(self, case: Trial, log: "Log") -> Row:
        from rtstack.papers.reference_spreading.worker import row_of_log

        return row_of_log(self._bench, case, log, self.columns)

    def tidy(self) -> None:
        """Remove the halves of logs that workers left which were killed."""
        for name in self._bench.archive.names(LOGS):
            if name.endswith(PARTIAL):
                self._bench.archive.remove(f"{LOGS}/{name}")

    def report(self, results: Results) -> Report:
        from rtstack.papers.reference_spreading.report import report

        return report(self.specification, self._bench, results, self._unrecorded)
