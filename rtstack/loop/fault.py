"""What ended a session, as evidence: put together after the last tick from what the ticks only noted."""

import traceback
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.extensions import blame, defined_at
from rtstack.control.controller import Controller, ObservedArm
from rtstack.control.records import WORKSPACE
from rtstack.loop.end import End
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.safety.judge import Cause, SafetyJudge
from rtstack.samples import SIDES, QpStatus


@dataclass(frozen=True, slots=True)
class FailedQp:
    """A QP without an answer; problem: the WORKSPACE (1,) of its tick."""

    side: str
    status: QpStatus
    iterations: int
    problem: NDArray[np.void]


@dataclass(frozen=True, slots=True)
class Fault:
    """What ended a session: see WatchdogTrip for what was found and allowed. t_ns: robot's time of the tick that saw
    it. reaction_ticks: from that tick to the one in which both arms were given the judge's stopping torque, None where
    they were being stopped already, or the robot ended torque control itself."""

    trip: WatchdogTrip
    t_ns: int
    reaction_ticks: int | None
    traceback: str = ""
    qp: FailedQp | None = None

    @property
    def end(self) -> End:
        """How the session ended."""
        return self.trip.end


class FaultNotes:
    """What a session notes in its ticks, in memory that is there already. The first fault stays."""

    def __init__(self, sides: Sequence[str] = SIDES) -> None:
        self._sides = sides
        self.trip = WatchdogTrip(End.COMPLETED, "")
        self.ended = False  # something has asked for the end
        self.t_ns = 0
        self.now_ns = 0  # since the start of the reference
        self.reaction_ticks: int | None = None
        self.error: BaseException | None = None
        self.qp_side = -1  # of the QP that was not solved
        self._qp_status, self._qp_iterations = QpStatus.NOT_USED, 0
        self._problem = np.zeros(1, WORKSPACE)
        self._problem_bytes = self._problem.view(np.uint8)

    def take(self, trip: WatchdogTrip, t_ns: int, now_ns: int) -> bool:
        """Note why the session ends; return whether this is why. A fault replaces an end that is none."""
        if self.ended and not (trip.end.is_fault and not self.trip.end.is_fault):
            return False
        self.trip, self.t_ns, self.now_ns, self.ended = trip, t_ns, now_ns, True
        return True

    def take_qp(self, side: int, arm: ObservedArm) -> None:
        """Keep the problem that was not solved in this tick; the first one stays."""
        if self.qp_side < 0:
            self._problem_bytes[:] = arm.workspace.view(np.uint8)
            self._qp_status = QpStatus(int(arm.control["qp_status"][0]))
            self._qp_iterations = int(arm.control["qp_iterations"][0])
            self.qp_side = side

    def fault(self) -> Fault | None:
        """Return the fault, None for a session without one. Not for the tick."""
        if not self.trip.end.is_fault:
            return None
        text = "".join(traceback.format_exception(self.error)) if self.error is not None else ""
        qp = None
        if self.qp_side >= 0:
            qp = FailedQp(self._sides[self.qp_side], self._qp_status, self._qp_iterations, self._problem)
        return Fault(self.trip, self.t_ns, self.reaction_ticks, text, qp)


def plug_ins_of(controller: Controller) -> tuple[object, ...]:
    """Return the functions of a controller that a tick calls, and that another author may have written."""
    laws = getattr(controller, "laws", None) or ()
    detectors = (getattr(arm, "detector", None) for arm in controller.arms)
    called = (*(getattr(law, "command", law) for law in laws), *(each.update for each in detectors if each is not None))
    return (*called, controller.machine.update, controller.command)


def explained(judge: SafetyJudge, sample: NDArray[np.void], called: Sequence[object]) -> str:
    """Return in one line why a judge stops its arm; of a torque that is not finite, which one, and whose it is."""
    torque = sample["tau_desired"][0]
    if judge.reason is not Cause.NOT_FINITE or np.isfinite(torque).all():
        return judge.explanation
    joint = int(np.argmin(np.isfinite(torque)))
    where = blame(defined_at(*called))
    return f"joint {joint + 1}: the desired torque is {torque[joint]} {where}".rstrip()
