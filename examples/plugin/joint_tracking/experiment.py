"""An experiment of its own: how far the pads are from their reference before the impact, by controller.

A plan (kind = "tracking") names controllers and seeds. One demonstration is recorded first; each case is a trial.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.generic import mean_figure, mean_table
from rtstack.experiments.report import Report, Section
from rtstack.trials.controllers import ControllerName
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification

COLUMNS = {"controller": str, "seed": int, "success": bool, "error_mm": float}


@checked(frozen=True, slots=True, config=STRICT)
class Plan:
    """A plan's file. seeds: 1 to this number; 0 is the demonstration's, which a trial with it repeats exactly."""

    name: str
    title: str
    kind: str
    controllers: tuple[ControllerName, ...]
    seeds: Annotated[int, Field(ge=1, le=100)]
    quick: bool = False

    def size(self) -> int:
        """Return the number of trials."""
        return len(self.controllers) * self.seeds


@dataclass(frozen=True, slots=True)
class Case:
    """One trial."""

    controller: str
    seed: int

    @property
    def id(self) -> str:
        """CONTROLLER.SEED."""
        return f"{self.controller}.{self.seed}"


class Tracking(Experiment[Plan, Case]):
    """The kind of experiment."""

    def __init__(self, specification: Plan, request: Request) -> None:
        super().__init__(specification, request, COLUMNS, [request.file.path, default_cell_file()])

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        """Read a plan. `--quick` takes one seed."""
        plan = load_toml(path, Plan)
        return Plan(plan.name, plan.title, plan.kind, plan.controllers, 1, True) if quick else plan

    def stages(self) -> Stages:
        """Record the demonstration, where there is none yet."""
        reference = self.request.out / "reference.mcap"
        if not reference.exists():
            yield Stage("recording", [Task("reference", record, (reference,))])

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """Return all trials."""
        plan = self.specification
        return [Case(name, 1 + k) for name in plan.controllers for k in range(plan.seeds)]

    def tasks(self, cases: Sequence[Case]) -> Iterable[Task]:
        """Return a task for each trial."""
        reference = self.request.out / "reference.mcap"
        return [Task(case.id, run, (reference, case), (case,)) for case in cases]

    def report(self, results: Results) -> Report:
        """Return the table and the figure."""
        headings = {"error_mm": "error, mm", "success": "success"}
        table = mean_table("Error before the impact", results.rows, ["controller"], headings)
        figure = mean_figure(
            "tracking.png", "Error before the impact, by seed.", results.rows, "seed", "controller", "error_mm", "mm"
        )
        return Report([Section(self.specification.title, tables=[table], figures=[figure])])


def record(path: Path) -> str | None:
    """Record the plain demonstration. Returns why there is none."""
    from rtstack.trials.demonstration import run_demonstration
    from rtstack.trials.record import open_log

    description, file = load_description(None)
    asked = DemonstrationSpecification()
    cell = open_cell("direct", asked.object, 0.0, asked.seed, description)
    try:
        log = open_log(path, asked, description, cell.name, file, overwrite=True)
        return run_demonstration(asked, description, cell, RunContext(log)).failure_reason
    finally:
        cell.close()


def run(reference: Path, case: Case) -> list[Row]:
    """Run a trial. Returns its row."""
    from rtstack.trials.record import open_log
    from rtstack.trials.trial import prepare_trial, run_trial

    description, file = load_description(None)
    asked = TrialSpecification(str(reference), case.controller, seed=case.seed)
    prepared = prepare_trial(asked, description)
    cell = open_cell("direct", asked.object, 0.0, case.seed, description)
    path = reference.parent / f"{case.id}.mcap"
    try:
        log = open_log(path, asked, description, cell.name, file, reference=prepared.reference, overwrite=True)
        result = run_trial(prepared, cell, RunContext(log))
    finally:
        cell.close()
    error_m = _error_m(path, prepared.reference.nominal_impact_s)
    row = {"id": case.id, "controller": case.controller, "seed": case.seed, "success": result.success}
    return [row | {"error_mm": 1e3 * error_m, "ticks": result.ticks}]


def _error_m(path: Path, nominal_impact_s: float) -> float:
    """Return the root mean square of the pads' distance from their reference, from the start to 0.1 s before the
    impact."""
    from rtstack.log.reader import read_log
    from rtstack.trials.review import log_columns

    columns = log_columns(read_log(path))
    count = round((nominal_impact_s - 0.1) / 1e-3)
    position = columns.arm["O_T_EE"][:, :count].reshape(2, count, 4, 4)[..., :3, 3]
    moved = position - position[:, :1]
    wanted = columns.control["pose_ref"][:, :count, :3]
    # both from their start: a pose of the robot is in the frame of its base, which is parallel to the world's
    return float(np.sqrt(np.mean(np.sum((moved - (wanted - wanted[:, :1])) ** 2, axis=-1))))
