"""Bring the arms of an open cell elsewhere, by the way to the start of a run that then ends at once."""

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription, StartMotionLimits
from rtstack.safety.limits import ForcePhase
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.move import run_motion
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.start_motion import JointPath, MeasuredPoints, StartMotion

QUICK = StartMotionLimits(1.0, 5.0)


def where(cell: Cell) -> NDArray[np.float64]:
    """Return where the arms are, (arms, 7) rad."""
    return np.stack([arm.read().q.copy() for arm in cell.arms])


def go(
    cell: Cell, description: CellDescription, goal: NDArray[np.float64], context: RunContext = NO_CONTEXT,
    limit: StartMotionLimits = QUICK,
) -> str | None:  # fmt: skip
    """Move the arms to goal (arms, 7) rad; return why they did not get there, None where they did."""
    parameters = cell_parameters(description)
    control, end = parameters.control, MeasuredPoints(0.002, len(goal))
    plan = SessionPlan.from_source(end, control.stiffness, control.period_s, ForcePhase.APPROACH)
    way = StartMotion(JointPath.between(where(cell), goal, limit), limit)
    return run_motion(plan, description, parameters, cell, context.with_watchdog(end), way=way)[0]
