"""The motion of an identification: one joint of each arm to and fro, in free space, at several speeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.cell import Cell
from rtstack.control.parameters import ControlParameters
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.references.quintic import ViaPoint, quintic_path
from rtstack.samples import Mode
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.move import MotionResult, run_motion, where_arms_stand
from rtstack.trials.run_context import RunContext
from rtstack.trials.start_motion import StartMotion, posture
from rtstack.trials.tightening import limits_of_arms

# where the sweeps are: pads apart, over any object, in the middle of what grabs use. m, along the world's y and z
CENTRE_Y, CENTRE_Z = 0.25, 0.5
WAY_S = 1.6
REST_S = 0.2
BEGIN_S = REST_S + WAY_S + REST_S  # when the arms stand still at the centre
# rad/s: grabs and pushes stay below 1.3 but for their vibrations; friction changes most where velocity is small
PEAKS = (0.1, 0.3, 1.0)
LEG_S = 1.125  # from one end to the other: a quintic from rest to rest, whose peak is 1.875 times its mean
TONES_S = 18.0  # of the motion of all joints: amplitude rad, Hz of joint 1, and how much more for each joint
TONES = ((0.12, 0.23, 0.031), (0.035, 0.9, 0.083))
WIGGLE_RAD, WIGGLE_S = np.radians(1.0), 1.0
MIRROR = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # the right arm is the left one's mirror image


@dataclass(frozen=True, slots=True)
class Sweep:
    """joint: 0 to 6. plan: from home to the centre, the sweep, and home; samples between begin_s and end_s count."""

    joint: int
    plan: SessionPlan
    begin_s: float
    end_s: float


def sweep(description: CellDescription, arms: Sequence[ArmController], joint: int) -> Sweep:
    """Return the sweep of a joint (0 to 6) of each arm, two as mirror images. Raises TrialError for want of room."""
    points, t_s = [ViaPoint(BEGIN_S, 0.0)], BEGIN_S
    for peak in PEAKS:
        reach = peak * LEG_S / 1.875 / 2.0
        for part, place in ((0.5, reach), (1.0, -reach), (1.0, reach), (0.5, 0.0)):
            t_s += part * LEG_S
            points.append(ViaPoint(t_s, place))
    t = _ticks_s(t_s)
    away = np.zeros((len(t), 7))
    away[:, joint], _ = quintic_path(points, t)
    return Sweep(joint, _about_centre(description, arms, away, t_s, f"the sweep of joint {joint + 1}"), BEGIN_S, t_s)


def all_joints(description: CellDescription, arms: Sequence[ArmController], run: int) -> SessionPlan:
    """Return a motion of all joints of all arms at once, two arms as mirror images: two tones a joint, other phases
    each run. All frequencies differ, so that no joint can pass for another one. Raises TrialError where there is no
    room."""
    end_s = BEGIN_S + TONES_S
    t = _ticks_s(end_s)
    fade, _ = quintic_path(
        [ViaPoint(BEGIN_S, 0.0), ViaPoint(BEGIN_S + 1.0, 1.0), ViaPoint(end_s - 1.0, 1.0), ViaPoint(end_s, 0.0)], t
    )
    phases = np.random.default_rng(run).uniform(0.0, 2.0 * np.pi, (2, 7))
    joints = np.arange(7)
    away = fade[:, None] * sum(
        reach * np.sin(2.0 * np.pi * t[:, None] * (hz + step_hz * joints) + phase)
        for (reach, hz, step_hz), phase in zip(TONES, phases, strict=True)
    )
    return _about_centre(description, arms, away, end_s, "the motion of all joints")


def _ticks_s(end_s: float) -> Array:
    """Return the times of the ticks of a motion that goes on at the centre until end_s, and home again."""
    period_s = ControlParameters().period_s
    return np.arange(round((end_s + 2 * REST_S + WAY_S) / period_s)) * period_s


def _about_centre(
    description: CellDescription, arms: Sequence[ArmController], away: Array, end_s: float, what: str
) -> SessionPlan:
    """Return the motion of `away` (n, 7), rad, from the centre, which ends at end_s; from home and back."""
    control, t = ControlParameters(), _ticks_s(end_s)
    there = [ViaPoint(REST_S, 0.0), ViaPoint(REST_S + WAY_S, 1.0)]
    back = [ViaPoint(end_s + REST_S, 1.0), ViaPoint(end_s + REST_S + WAY_S, 0.0)]
    share, _ = quintic_path(there + back, t)
    targets = np.zeros((len(arms), len(t)), POINT)
    for points, arm, (side, mounting) in zip(targets, arms, description.mountings.items(), strict=True):
        home = np.array(mounting.home)
        q = home + share[:, None] * (_centre(arm, home, side) - home) + (away if side == "left" else MIRROR * away)
        _follow(arm, q, control.period_s, points)
    for points, limits in zip(targets["position"], limits_of_arms(description), strict=True):
        if not np.all((points >= limits.ee_lower) & (points <= limits.ee_upper)):
            raise TrialError(
                f"{what} would leave the cell's box (ee_lower, ee_upper under [safety]): identify on a cell with more "
                "room"
            )
    return SessionPlan(targets, targets, Mode.TELEOPERATION, control.stiffness, control.period_s)


def wiggle(arms: Sequence[ArmController], q: Array, side: int, joint: int) -> SessionPlan:
    """Return a turn of one joint (0 to 6) of one arm by WIGGLE_RAD and back; all arms begin at q (arms, 7), rad."""
    control = ControlParameters()
    t = np.arange(round((2 * REST_S + 2 * WIGGLE_S) / control.period_s)) * control.period_s
    way = [ViaPoint(REST_S, 0.0), ViaPoint(REST_S + WIGGLE_S, 1.0), ViaPoint(REST_S + 2 * WIGGLE_S, 0.0)]
    away, _ = quintic_path(way, t)
    targets = np.zeros((len(arms), len(t)), POINT)
    for k, arm in enumerate(arms):
        moved = np.tile(q[k], (len(t), 1))
        if k == side:
            moved[:, joint] += WIGGLE_RAD * away * (-1.0 if q[k, joint] > 0.0 else 1.0)  # to the middle of its range
        _follow(arm, moved, control.period_s, targets[k])
    return SessionPlan(targets, targets, Mode.TELEOPERATION, control.stiffness, control.period_s)


@dataclass(frozen=True, slots=True)
class PreparedWiggle(PreparedRun[MotionResult]):
    """One joint (1 to 7) of an arm turns by a degree and back, where the arms stand. side: 0 left, 1 right."""

    led: ClassVar[bool] = True
    side: int

    @property
    def refusal(self) -> str:
        return ""  # a degree is allowed before the cell is commissioned

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> MotionResult:
        parameters = cell_parameters(self.description)
        q = where_arms_stand(self.description, cell).q
        plan = wiggle(arm_controllers(self.description, parameters), q, self.side, self.specification.joint - 1)
        reason, columns = run_motion(plan, self.description, parameters, cell, context)
        return MotionResult(reason is None, reason, columns)


def _centre(arm: ArmController, home: Array, side: str) -> Array:
    work, point = arm.observed_at(home), np.zeros(1, POINT)
    point["rotation"][0] = work["rotation"]
    x, y, _ = work["position"]
    point["position"][0] = x, np.copysign(CENTRE_Y, y), CENTRE_Z
    point["xi"] = home[arm.parameters.posture_joint]
    return posture(arm, home, point[0], side)


def _follow(arm: ArmController, q: Array, period_s: float, points: NDArray) -> None:
    """Write the points (n,) at which the pad and the posture's joint are when the arm is at q (n, 7), rad."""
    dq = np.gradient(q, period_s, axis=0)
    joint = arm.parameters.posture_joint
    for i in range(len(q)):
        work = arm.observed_at(q[i], dq[i])
        for name in ("position", "rotation", "twist"):
            points[name][i] = work[name]
    points["xi"], points["dxi"] = q[:, joint], dq[:, joint]
    points["beta"] = np.gradient(dq[:, joint], period_s)
