"""Guide mode: a person moves both arms by hand, also back from beyond a limit, for as long as the key is held."""

import numpy as np

from hal.cell import Cell
from rtstack.control.controller import ObservedArm
from rtstack.control.guiding import GuidingLaw
from rtstack.control.modes import Strategy
from rtstack.control.records import POINT
from rtstack.control.tick import DualArmController
from rtstack.loop.end import End
from rtstack.loop.session import SessionPlan
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.model.cell_description import CellDescription
from rtstack.safety.guided import Standing, beyond, beyond_limits, guided_limits, outside_robot, standing
from rtstack.safety.limits import ForcePhase
from rtstack.samples import Level
from rtstack.trials.assembly import ControllerRequest, cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.result import GuideResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.scoring import failure_reason
from rtstack.trials.tightening import limits_of_arms

_RELEASED = (End.RELEASED, End.STOP_REQUESTED, End.COMPLETED)


class _Hand:
    """A session's guide whose points are where the arms are, and a watchdog that ends it after so many seconds."""

    def __init__(self, seconds: float | None) -> None:
        self.points = np.zeros((2, 1), POINT)
        self._most_ns = None if seconds is None else round(seconds * 1e9)
        self._began_ns: int | None = None
        self._now_ns = 0

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write where the arm is: there is nothing to be followed."""
        point, work = self.points[side], arm.workspace[0]
        point["position"], point["rotation"] = work["position"], work["rotation"]
        if side == 0:
            self._now_ns = int(arm.sample["t_ns"][0])
            self._began_ns = self._now_ns if self._began_ns is None else self._began_ns

    def trip(self) -> WatchdogTrip | None:
        """See rtstack.loop.watchdogs.Watchdog."""
        if self._most_ns is None or self._began_ns is None or self._now_ns - self._began_ns < self._most_ns:
            return None
        return WatchdogTrip(End.COMPLETED, "", Level.INFO)


def where_arms_stand(description: CellDescription, cell: Cell) -> Standing:
    """Return where the arms of an open cell stand. Raises HardwareError."""
    q = np.array([arm.read().q for arm in (cell.left, cell.right)])
    bases = (description.left.base, description.right.base)
    return standing(q, bases, description.tools, limits_of_arms(description))


def run_guide(
    description: CellDescription, cell: Cell, context: RunContext = NO_CONTEXT, seconds: float | None = None
) -> GuideResult:
    """Let a person move the arms of an open cell, until a watchdog or the stop of the context ends it. Closes the log.

    seconds: of the robot's time, at most. Raises TrialError with one line where an arm stands at the robot's own limit;
    HardwareError, RecoveryRefused from the arms.
    """
    limits = limits_of_arms(description)
    for arm in (cell.left, cell.right):
        arm.recover()
    where = where_arms_stand(description, cell)
    if stuck := outside_robot(limits, where):
        raise TrialError(f"{stuck}: no program may move it there; move it on its Desk page, with the enabling device")
    before = beyond(limits, where)
    hand, parameters = _Hand(seconds), cell_parameters(description)
    control = parameters.control
    plan = SessionPlan.guided(hand, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)

    def controller(request: ControllerRequest) -> DualArmController:
        left, right = (
            GuidingLaw(arm, limits[side], beyond_limits(limits[side], where, side))
            for side, arm in enumerate(request.arms)
        )
        return request.pair(request.modes(Strategy.PROPOSED), (left, right))

    context = context.with_watchdog(hand)
    with Run(description, parameters, plan, guided_limits(limits, where), context, None) as run:
        outcome = run.follow(cell, controller, 0.0)
        ended = outcome.end in _RELEASED
        reason = None if ended else failure_reason(outcome.end, outcome.detail, outcome.safety_interventions)
        there = where if outcome.end is End.HARDWARE else where_arms_stand(description, cell)
        result = GuideResult(
            success=reason is None, failure_reason=reason, cell=cell.name,
            pads=tuple(tuple(face) for face in there.face.round(4).tolist()),
            beyond_before=before, beyond_after=beyond(limits, there),
            safety_interventions=outcome.safety_interventions, log=run.log_name,
        )  # fmt: skip
        return run.finished(result)
