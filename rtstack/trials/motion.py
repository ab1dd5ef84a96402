"""Follows a plan that meets nothing, on a cell: what an identification moves the arms by."""

from dataclasses import dataclass
from typing import Any

from hal.cell import Cell
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import Parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.result import Result
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.start_motion import StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms


@dataclass(frozen=True, slots=True)
class MotionResult(Result):
    """What came out of a motion, with its samples."""

    columns: Columns


@dataclass(frozen=True, slots=True)
class PreparedMotion(PreparedRun[MotionResult]):
    """Both arms follow a plan that meets nothing: the object is out of their way. noise: seed of the cell's noise.
    overwrite: a log of the same name that was broken off."""

    plan: SessionPlan
    parameters: Parameters
    noise: int
    overwrite: bool = False

    @property
    def noise_seed(self) -> int:
        return self.noise

    def about(self) -> dict[str, Any]:
        return {"overwrite": self.overwrite}

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: home, whatever object the cell has."""
        return start_motion(cell, self.description, "")

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> MotionResult:
        reason, columns = run_motion(self.plan, self.description, self.parameters, cell, context, way=way)
        return MotionResult(reason is None, reason, columns)


def run_motion(
    plan: SessionPlan, description: CellDescription, parameters: Parameters, cell: Cell,
    context: RunContext = NO_CONTEXT, *, way: StartMotion | None = None,
) -> tuple[str | None, Columns]:  # fmt: skip
    """Follow a plan that meets nothing, on an open cell. Closes the log, not the cell. Returns why it failed, None for
    a success, and the samples."""
    with Run(description, parameters, plan, limits_of_arms(description), context, way) as run:
        reason = run.follow(cell).problem
        incomplete = run.close({"success": reason is None, "failure_reason": reason})
    return reason or incomplete, run.history.columns()
