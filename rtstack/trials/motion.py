"""Follows a plan that meets nothing, on a cell: what an identification moves the arms by."""

from hal.cell import Cell
from rtstack.control.modes import Strategy
from rtstack.loop.history import Columns
from rtstack.loop.session import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import Parameters, following
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.scoring import failure_reason
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import limits_of_arms


def run_motion(
    plan: SessionPlan,
    description: CellDescription,
    parameters: Parameters,
    cell: Cell,
    context: RunContext = NO_CONTEXT,
    *,
    way: StartMotion | None = None,
) -> tuple[str | None, Columns]:
    """Follow a plan that meets nothing, on an open cell. Closes the log, not the cell.

    Returns why it failed, None for a success, and the samples.
    """
    with Run(description, parameters, plan, limits_of_arms(description), context, way) as run:
        outcome = run.follow(cell, following(Strategy.PROPOSED), 0.0)
        reason = failure_reason(outcome.end, outcome.detail, outcome.safety_interventions)
        incomplete = run.close({"success": reason is None, "failure_reason": reason})
    return reason or incomplete, run.history.columns()
