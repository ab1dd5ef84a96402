"""Runs a motion that an operator asks for on a cell: go to the start, put down what is held, open.

It begins where the arms are, after a stop or a fault too, on the cell as it is: what they hold is not let go.
"""

from dataclasses import dataclass

import numpy as np

from hal.cell import Cell
from rtstack.control.modes import Strategy
from rtstack.loop.session import SessionPlan
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.references.demonstration import end_effector_pose
from rtstack.safety.limits import ForcePhase, PairLimits
from rtstack.teleoperation.mover import Home, Mover
from rtstack.teleoperation.reach import Reach
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters, following
from rtstack.trials.errors import TrialError
from rtstack.trials.look import object_before
from rtstack.trials.result import MoveResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.scoring import failure_reason
from rtstack.trials.specification import HandMotion, MoveSpecification
from rtstack.trials.tightening import limits_of_arms

HELD_N = 5.0  # on both pads, away from each other: the impact detector's force_high
ON_TABLE_M = 0.015  # below it an object that the tracker sees stands on the table
OPENING_M = 0.08
LOOKS = 20  # states that a force is the mean of


@dataclass(frozen=True, slots=True)
class PreparedMove:
    """A motion that may be begun."""

    specification: MoveSpecification
    description: CellDescription
    parameters: Parameters
    limits: PairLimits


def prepare_move(
    specification: MoveSpecification, description: CellDescription, cell: Cell, *, let_fall: bool = False
) -> PreparedMove:
    """Look at an open cell whether a motion may begin. let_fall: what is held above the table, too.

    Raises TrialError with one line, HardwareError from the arms.
    """
    held, above = _held(cell, description), _above_table(cell, description, specification.object)
    match specification.motion:
        case HandMotion.PUT_DOWN if not held:
            raise TrialError("nothing is held between the pads: there is nothing to put down")
        case HandMotion.START if held:
            raise TrialError("the pads hold something: put it down first")
        case HandMotion.OPEN if let_fall and not held:
            raise TrialError("nothing is held between the pads")
        case HandMotion.OPEN if held and not let_fall and (above is None or above > ON_TABLE_M):
            where = "above the table" if above is None else f"{1e3 * above:.0f} mm above the table"
            raise TrialError(f"what the pads hold is {where}, and would fall: put it down first")
    return PreparedMove(specification, description, cell_parameters(description), limits_of_arms(description))


def run_move(prepared: PreparedMove, cell: Cell, context: RunContext = NO_CONTEXT) -> MoveResult:
    """Carry a prepared motion out on the same open cell. Closes the log, not the cell."""
    specification, description, parameters = prepared.specification, prepared.description, prepared.parameters
    control, motion = parameters.control, specification.motion
    stiffness = control.stiffness_teleoperation
    home = _home(description, parameters) if motion is HandMotion.START else None
    reach = Reach.within(prepared.limits[0])
    mover = Mover(reach, float(stiffness[0]), OPENING_M, motion is HandMotion.PUT_DOWN, home)
    phase = ForcePhase.APPROACH if motion is HandMotion.START else ForcePhase.CONTACT
    plan = SessionPlan.guided(mover, stiffness, control.period_s, phase)
    with Run(description, parameters, plan, prepared.limits, context.with_watchdog(mover), None) as run:
        run.share = lambda: mover.share
        outcome = run.follow(cell, following(Strategy.PROPOSED), 0.0)
        reason = failure_reason(outcome.end, outcome.detail, outcome.safety_interventions) or mover.problem or None
        result = MoveResult(
            success=reason is None,
            failure_reason=reason,
            motion=str(motion),
            object=specification.object,
            cell=cell.name,
            lowered_mm=1e3 * mover.lowered_m,
            missed_deadlines=outcome.missed_deadlines,
            safety_interventions=outcome.safety_interventions,
            log=run.log_name,
        )
        return run.finished(result)


def _held(cell: Cell, description: CellDescription) -> bool:
    """Whether both pads are pressed away from each other."""
    bases = base_frame(description.left), base_frame(description.right)
    forces = np.zeros(2)
    for _ in range(LOOKS):
        for side, arm in enumerate((cell.left, cell.right)):
            # the world's y of what the object does to the pad
            forces[side] -= (bases[side].rotation @ arm.read().record["O_F_ext_hat_K"][0, :3])[1] / LOOKS
    return bool(forces[0] > HELD_N and -forces[1] > HELD_N)


def _above_table(cell: Cell, description: CellDescription, name: str) -> float | None:
    """Return how far above the table the object's lower face is, m; None where it is not seen."""
    thing, pose = description.objects.get(name), object_before(cell, description)
    if thing is None or not pose.record["seen"][0]:
        return None
    return float(pose.position[2]) - thing.size[2] / 2.0 - description.table.top_z


def _home(description: CellDescription, parameters: Parameters) -> Home:
    arms = arm_controllers(description, parameters)
    homes = np.array([description.left.home, description.right.home])
    poses = [end_effector_pose(arm.model, q) for arm, q in zip(arms, homes, strict=True)]
    joint = arms[0].parameters.posture_joint
    return Home(np.array([p for p, _ in poses]), np.array([R for _, R in poses]), homes[:, joint].copy())
