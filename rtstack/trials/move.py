"""Runs that an operator asks for on a cell: go to the start, put down what is held, open; and lead both arms by hand.

A motion begins where the arms are, after a stop or a fault too, on the cell as it is: what they hold is not let go. In
guide mode a person moves the arms by hand, also back from beyond a limit, for as long as the key is held.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.control.guiding import GuidingLaw
from rtstack.control.modes import Strategy
from rtstack.control.tick import CellController
from rtstack.loop.end import End
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription, LoadPolicy
from rtstack.references.demonstration import end_effector_pose
from rtstack.safety.guided import Standing, beyond, beyond_limits, guided_limits, outside_robot, standing
from rtstack.safety.limits import ForcePhase
from rtstack.teleoperation.mover import Home, Mover
from rtstack.teleoperation.reach import Reach
from rtstack.trials.assembly import ControllerRequest, Parameters, arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import resting_force
from rtstack.trials.placement import blocks_start
from rtstack.trials.result import GuideResult, MoveResult, Result
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.sight import object_before
from rtstack.trials.specification import GuideSpecification, HandMotion, MoveSpecification
from rtstack.trials.start_motion import MeasuredPoints, StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms


@dataclass(frozen=True, slots=True)
class MotionResult(Result):
    """What came out of a motion, with its samples."""

    columns: Columns


@dataclass(frozen=True, slots=True)
class PreparedMotion(PreparedRun[MotionResult]):
    """Both arms follow a plan that meets nothing, as an identification moves them: the object is out of their way.

    noise: seed of the cell's noise. overwrite: a log of the same name that was broken off.
    """

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


HELD_N = 5.0  # on both pads, away from each other: the impact detector's force_high
ON_TABLE_M = 0.015  # below it an object that the tracker sees stands on the table
OPENING_M = 0.08
LOOKS = 20  # states that a force is the mean of
_RELEASED = (End.RELEASED, End.STOP_REQUESTED, End.COMPLETED)
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


@dataclass(frozen=True, slots=True)
class PreparedMove(PreparedRun[MoveResult]):
    """A motion from where the arms of the open cell are. let_fall: it may open above the table, too."""

    keeps_open_cell: ClassVar[bool] = True
    watched: ClassVar[bool] = False  # a load is put down also where no tracker sees it
    specification: MoveSpecification
    let_fall: bool = False

    def look(self, cell: Cell) -> str:
        """See PreparedRun: whether the motion may begin. Raises TrialError with one line, HardwareError."""
        held, above = holds(cell, self.description), _above_table(cell, self.description, self.specification.object)
        match self.specification.motion:
            case HandMotion.PUT_DOWN if not held:
                raise TrialError("nothing is held between the pads: there is nothing to put down")
            case HandMotion.START if held:
                raise TrialError("the pads hold something: put it down first")
            case HandMotion.START if blocked := blocks_start(cell, self.description, self.specification.object):
                raise TrialError(blocked)
            case HandMotion.OPEN if self.let_fall and not held:
                raise TrialError("nothing is held between the pads")
            case HandMotion.OPEN if held and not self.let_fall and (above is None or above > ON_TABLE_M):
                where = "above the table" if above is None else f"{1e3 * above:.0f} mm above the table"
                raise TrialError(f"what the pads hold is {where}, and would fall: put it down first")
        return ""

    def run(self, cell: Cell, context: RunContext = NO_CONTEXT, way: StartMotion | None = None) -> MoveResult:
        specification, description = self.specification, self.description
        parameters, limits = cell_parameters(description), limits_of_arms(description)
        control, motion = parameters.control, specification.motion
        stiffness = control.stiffness_teleoperation
        home = _home(description, parameters) if motion is HandMotion.START else None
        reach = Reach.within(limits[0])
        lowers = motion is HandMotion.PUT_DOWN
        mover = Mover(reach, float(stiffness[0]), OPENING_M, lowers, home, len(description.arms))
        phase = ForcePhase.APPROACH if motion is HandMotion.START else ForcePhase.CONTACT
        plan = SessionPlan.from_source(mover, stiffness, control.period_s, phase)
        with Run(description, parameters, plan, limits, context.with_watchdog(mover), None) as run:
            run.share = lambda: mover.share
            outcome = run.follow(cell)
            return run.finished(
                MoveResult, outcome.problem or mover.problem or None, specification, outcome, motion=str(motion),
                lowered_mm=1e3 * mover.lowered_m,
            )  # fmt: skip


@dataclass(frozen=True, slots=True)
class PreparedGuide(PreparedRun[GuideResult]):
    """A person pushes both arms of the open cell."""

    keeps_open_cell: ClassVar[bool] = True
    led: ClassVar[bool] = True
    specification: GuideSpecification

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None = None) -> GuideResult:
        """See PreparedRun: until a watchdog, the stop of the context or its seconds end it. Raises TrialError where an
        arm stands at the robot's own limit; HardwareError, RecoveryRefused from the arms."""
        description = self.description
        limits = limits_of_arms(description)
        for arm in cell.arms:
            arm.recover()
        where = where_arms_stand(description, cell)
        if stuck := outside_robot(limits, where, description.sides):
            raise TrialError(
                f"{stuck}: no program may move it there; move it on its Desk page, with the enabling device"
            )
        sides = description.sides
        before = beyond(limits, where, sides)
        hand, parameters = MeasuredPoints(self.specification.seconds, len(sides)), cell_parameters(description)
        control = parameters.control
        plan = SessionPlan.from_source(hand, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)

        def controller(request: ControllerRequest) -> CellController:
            laws = [
                GuidingLaw(arm, limits[side], beyond_limits(limits[side], where, side))
                for side, arm in enumerate(request.arms)
            ]
            return request.pair(request.modes(Strategy.PROPOSED), laws)

        context = context.with_watchdog(hand)
        with Run(description, parameters, plan, guided_limits(limits, where), context, None) as run:
            outcome = run.follow(cell, controller)
            reason = None if outcome.end in _RELEASED else outcome.problem
            there = where if outcome.end is End.HARDWARE else where_arms_stand(description, cell)
            return run.finished(
                GuideResult, reason, outcome, pads=tuple(tuple(face) for face in there.face.round(4).tolist()),
                beyond_before=before, beyond_after=beyond(limits, there, sides),
            )  # fmt: skip


def holds(cell: Cell, description: CellDescription) -> bool:
    """Whether both pads are pressed away from each other; one pad alone holds nothing."""
    if len(description.arms) == 1:
        return False
    left, right = -resting_force(cell, description, LOOKS)[:, 1]  # the world's y of what the object does to a pad
    return bool(left > HELD_N and -right > HELD_N)


def _above_table(cell: Cell, description: CellDescription, name: str) -> float | None:
    """Return how far above the table the object's lower face is, m; None where it is not seen."""
    thing, pose = description.objects.get(name), object_before(cell, description)
    if thing is None or not pose.record["seen"][0]:
        return None
    return float(pose.position[2]) - thing.size[2] / 2.0 - description.table.top_z


def _home(description: CellDescription, parameters: Parameters) -> Home:
    arms = arm_controllers(description, parameters)
    homes = description.home
    poses = [end_effector_pose(arm.model, q) for arm, q in zip(arms, homes, strict=True)]
    joint = arms[0].parameters.posture_joint
    return Home(np.array([p for p, _ in poses]), np.array([R for _, R in poses]), homes[:, joint].copy())


def where_arms_stand(description: CellDescription, cell: Cell) -> Standing:
    """Return where the arms of an open cell stand. Raises HardwareError."""
    q = np.array([arm.read().q for arm in cell.arms])
    return standing(q, description.bases, description.tools, limits_of_arms(description))


def settle_load(description: CellDescription, object_name: str, context: RunContext, cell: Cell, end: End) -> str:
    """Do what the cell's file says after a run that ended so, arms at rest; return it in one line, "" where nothing was
    done. Never raises for what a robot does. The motion has the run's stop and watchdogs, and no log of its own."""
    motion = _MOTIONS.get(description.load_after_stop)
    if motion is None or end in HELD_AFTER:
        return ""
    specification = MoveSpecification(motion, object_name)
    quiet = RunContext(None, context.live, context.stop, None, context.watchdogs)
    prepared = PreparedMove(specification, description, let_fall=motion is HandMotion.OPEN)
    try:
        prepared.look(cell)
        result = prepared.run(cell, quiet)
    except (TrialError, HardwareError) as error:
        return f"the load stays as it is: {error}"
    if not result.success:
        return f"the load stays as it is: {result.failure_reason}"
    return f"lowered by {result.lowered_mm:.0f} mm" if motion is HandMotion.PUT_DOWN else "let go of where it was"
