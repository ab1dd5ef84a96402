"""An experiment of its own: how far the pads are from their reference before the impact, by controller.

A plan (kind = "tracking") names controllers and seeds. One demonstration is recorded first; each case is a trial.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from hal.displacement import Displacement
from rtstack.cells import load_description
from rtstack.experiments.experiment import CellRun, Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.generic import mean_figure, mean_table
from rtstack.experiments.report import Report, Section
from rtstack.experiments.simulation import simulate
from rtstack.log.reader import Log
from rtstack.trials.controllers import ControllerName
from rtstack.trials.review import log_columns
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
    """The kind of experiment. It says each run once, for the simulator and for arms."""

    options = frozenset({"cell", "cell_file"})
    made = ("references",)

    def __init__(self, specification: Plan, request: Request) -> None:
        self._description, cell_file = load_description(request.cell_file)
        super().__init__(specification, request, COLUMNS, [request.file.path, cell_file])

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        """Read a plan. `--quick` takes one seed."""
        plan = load_toml(path, Plan)
        return Plan(plan.name, plan.title, plan.kind, plan.controllers, 1, True) if quick else plan

    @property
    def _reference(self) -> Path:
        return self.request.out / "references" / "reference.mcap"

    def stages(self) -> Stages:
        """Record the demonstration, where there is none yet."""
        from rtstack.trials.demonstration import prepare_demonstration

        self._reference.parent.mkdir(exist_ok=True)
        if not self._reference.exists():
            recording = CellRun(
                prepare_demonstration(DemonstrationSpecification(), self._description), self._reference,
                wanted=Displacement(),
            )  # fmt: skip
            arguments = recording, self.request.simulated_cell, self.request.cell_file
            yield Stage("recording", [Task("reference", simulate, arguments)], lambda name: recording)

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """Return all trials."""
        plan = self.specification
        return [Case(name, 1 + k) for name in plan.controllers for k in range(plan.seeds)]

    def on_cell(self, case: Case) -> CellRun:
        """Return a trial, on arms or on a simulated cell."""
        from rtstack.trials.trial import prepare_trial

        asked = TrialSpecification(str(self._reference), case.controller, seed=case.seed)
        log = self.request.out / "logs" / f"{case.id}.mcap"
        return CellRun(prepare_trial(asked, self._description), log, wanted=Displacement())

    def row_of_log(self, case: Case, log: Log) -> Row:
        """Return what a trial's log says of it."""
        result = log.metadata["result"]
        row = {"id": case.id, "controller": case.controller, "seed": case.seed, "success": result["success"] == "true"}
        return row | {"error_mm": 1e3 * _error_m(log), "ticks": int(result["ticks"])}

    def report(self, results: Results) -> Report:
        """Return the table and the figure."""
        headings = {"error_mm": "error, mm", "success": "success"}
        table = mean_table("Error before the impact", results.rows, ["controller"], headings)
        figure = mean_figure(
            "tracking.png", "Error before the impact, by seed.", results.rows, "seed", "controller", "error_mm", "mm"
        )
        return Report([Section(self.specification.title, tables=[table], figures=[figure])])


def _error_m(log: Log) -> float:
    """Return the root mean square of the pads' distance from their reference, from the start to 0.1 s before the
    impact, or to where the trial was stopped before."""
    columns = log_columns(log)
    count = min(round((float(log.metadata["trial"]["nominal_impact_s"]) - 0.1) / 1e-3), columns.arm.shape[1])
    position: NDArray[np.float64] = columns.arm["O_T_EE"][:, :count].reshape(2, count, 4, 4)[..., :3, 3]
    moved = position - position[:, :1]
    wanted: NDArray[np.float64] = columns.control["pose_ref"][:, :count, :3]
    # both from their start: a pose of the robot is in the frame of its base, which is parallel to the world's
    error: NDArray[np.float64] = moved - (wanted - wanted[:, :1])
    return float(np.linalg.norm(error)) / math.sqrt(error[..., 0].size)
