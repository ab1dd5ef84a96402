"""What becomes of an object that is still between the pads when a run ends: what the cell's file says of it."""

from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.loop.end import End
from rtstack.model.cell_description import CellDescription, LoadPolicy
from rtstack.trials.errors import TrialError
from rtstack.trials.move import prepare_move, run_move
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import HandMotion, MoveSpecification

# Ends after which nothing moves by itself: a person has asked for the stop or is not there, or a robot has left torque
# control and has to be recovered first. What is held stays held then, by the robots' own position controllers.
HELD_AFTER = frozenset(
    (
        End.COMPLETED, End.STOP_REQUESTED, End.RELEASED, End.CLUTCH_QUIET, End.CONSOLE_GONE, End.OPERATOR_GONE,
        End.POLICY_QUIET, End.PARENT_GONE, End.HARDWARE, End.CRASH, End.NOT_AT_REST, End.LOG_FAILED,
        End.TORQUE_NOT_TAKEN,
    )
)  # fmt: skip
_MOTIONS = {LoadPolicy.LOWER: HandMotion.PUT_DOWN, LoadPolicy.RELEASE: HandMotion.OPEN}


def settle_load(description: CellDescription, object_name: str, context: RunContext, cell: Cell, end: End) -> str:
    """Do what the cell's file says after a run that ended so, with both arms at rest; return it in one line, "" where
    nothing was done. Never raises for what a robot does.

    The motion has the run's stop and watchdogs, and no log of its own: the run's log has the line.
    """
    motion = _MOTIONS.get(description.load_after_stop)
    if motion is None or end in HELD_AFTER:
        return ""
    specification = MoveSpecification(motion, object_name)
    quiet = RunContext(None, context.live, context.stop, None, context.watchdogs)
    try:
        result = run_move(
            prepare_move(specification, description, cell, let_fall=motion is HandMotion.OPEN), cell, quiet
        )
    except (TrialError, HardwareError) as error:
        return f"the load stays as it is: {error}"
    if not result.success:
        return f"the load stays as it is: {result.failure_reason}"
    return f"lowered by {result.lowered_mm:.0f} mm" if motion is HandMotion.PUT_DOWN else "let go of where it was"
