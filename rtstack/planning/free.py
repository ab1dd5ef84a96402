"""The parts of a planned motion in free space: what Appendix A of the impact-map paper runs, and what comes of it.

A velocity that jumps cannot be run without an impact. So each part is run by itself, in the plan's own time: the
ante-impact part as it is, to rest after the nominal impact; the post-impact part from rest by a run-up that arrives at
the nominal impact with the velocity after it. With nothing in the way neither has an object's force in its feedforward.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from rtstack.control.parameters import ControlParameters
from rtstack.control.records import POINT
from rtstack.loop.plan import SessionPlan
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.planning.joints import feedforward, joint_motion
from rtstack.planning.planned import PlannedMotion
from rtstack.references.quintic import ViaPoint, quintic_motion, quintic_path
from rtstack.samples import Mode

STOP_S = 0.4
STEADY_S = 0.05  # at the velocity after the impact before it: a run-up's jerk is over by then
JUMP_M_S = 1e-3  # an arm whose velocity changes by less than this from tick to tick meets nothing
COLUMNS = 7  # x, y, z, turned about them, posture


class PlanPhase(StrEnum):
    """Of a plan: before its impact, or after it."""

    ANTE = "ante"
    POST = "post"


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A part of a plan to be run with nothing in the way. The points begin..end of `plan` are those of the planned
    motion at the same ticks, without an object's force; what is before and after leads there and to rest."""

    plan: SessionPlan
    begin: int
    end: int


def free_motion(
    planned: PlannedMotion, description: CellDescription, part: PlanPhase, control: ControlParameters, after_s: float
) -> FreeMotion:
    """Return the free motion of a part; of the post-impact one the first after_s. Raises PlanError."""
    recording = planned.recording
    n, k = recording.points.shape[1], recording.impact
    begin, end = (0, k) if part is PlanPhase.ANTE else (k, min(k + round(after_s / recording.period_s), n))
    targets = []
    for arm, (side, mounting) in enumerate(description.mountings.items()):
        points, period_s = recording.points[arm], recording.period_s
        model, joint = ArmModel(mounting, description.pad), control.posture_joint
        jumps = np.abs(_velocity(points[k]) - _velocity(points[k - 1])).max() > JUMP_M_S
        head, head_acceleration = _run_up(points, k, period_s) if begin and jumps else (points[:begin], None)
        tail, tail_acceleration = _stop(points[end - 1], points["rotation"][0], period_s)
        pieces = tuple(piece for piece in (head, points[begin:end], tail) if len(piece))
        moved = joint_motion(model, np.array(mounting.home), pieces, period_s, joint, side)
        acceleration = np.concatenate(
            [planned.acceleration[arm, :begin] if head_acceleration is None else head_acceleration,
             planned.acceleration[arm, begin:end], tail_acceleration]
        )  # fmt: skip
        whole = np.concatenate(pieces)
        whole["wrench_ff"], whole["beta"] = feedforward(moved, acceleration, np.zeros((len(whole), 7)), joint)
        targets.append(whole)
    whole = np.array(targets)
    return FreeMotion(SessionPlan(whole, whole, Mode.TELEOPERATION, control.stiffness, recording.period_s), begin, end)


def compensated(planned: PlannedMotion, acceleration: Array) -> PlannedMotion:
    """Return the plan with an acceleration (arms, n, 7) more in its feedforward: of the pad's six coordinates along the
    world's axes, m/s^2 and rad/s^2, and of the posture's joint, rad/s^2."""
    points = planned.recording.points.copy()
    for arm, motion in enumerate(planned.joints):
        wrench, beta = feedforward(motion, acceleration[arm], np.zeros_like(motion.q), 0)  # no torque beside it
        points[arm]["wrench_ff"] += wrench
        points[arm]["beta"] += beta
    return replace(planned, recording=replace(planned.recording, points=points))


def _place(point: NDArray, level: Array) -> Array:
    turned = Rotation.from_matrix(point["rotation"] @ level.T).as_rotvec()
    return np.concatenate([point["position"], turned, [point["xi"]]])


def _velocity(point: NDArray) -> Array:
    return np.append(point["twist"], point["dxi"])


def _points(level: Array, vias: list[list[ViaPoint]], t_s: Array, period_s: float) -> tuple[NDArray, Array]:
    """Return the points (n,) along the via points of each column, and accelerations (n, 7) as `points_along` does. A
    pad turns from `level` about one axis: the rotation vector's rate is its angular velocity."""
    points, acceleration = np.zeros(len(t_s), POINT), np.zeros((len(t_s), COLUMNS))
    place, velocity = np.zeros((len(t_s), COLUMNS)), np.zeros((len(t_s), COLUMNS))
    for column, path in enumerate(vias):
        place[:, column], velocity[:, column] = quintic_path(path, t_s)
        acceleration[:, column] = quintic_motion(path, t_s + period_s / 2.0)[2]
    points["position"], points["xi"] = place[:, :3], place[:, 6]
    points["twist"], points["dxi"] = velocity[:, :6], velocity[:, 6]
    points["rotation"] = Rotation.from_rotvec(place[:, 3:6]).as_matrix() @ level
    return points, acceleration


def _run_up(points: NDArray, k: int, period_s: float) -> tuple[NDArray, Array]:
    """Return k points from rest at the start to the k-th: each coordinate gathers its speed over its way, and one that
    has none to gather, as the posture, takes all the time there is."""
    vias = []
    steady_s = k * period_s - STEADY_S
    level = points["rotation"][0]
    ways = _place(points[0], level), _place(points[k], level), _velocity(points[k])
    for p0, touch, v in zip(*ways, strict=True):
        p = touch - v * STEADY_S
        gathering_s = 2.0 * (p - p0) / v if (p - p0) * v > 0.0 else steady_s
        begin = ViaPoint(max(steady_s - gathering_s, 0.0), p0)
        vias.append([begin, ViaPoint(steady_s, p, v), ViaPoint(k * period_s, touch, v)])
    return _points(level, vias, np.arange(k) * period_s, period_s)


def _stop(last: NDArray, level: Array, period_s: float) -> tuple[NDArray, Array]:
    """Return the points after the last one, to rest."""
    vias = [
        [ViaPoint(0.0, p, v), ViaPoint(STOP_S, p + v * STOP_S / 2.0)]
        for p, v in zip(_place(last, level), _velocity(last), strict=True)
    ]
    return _points(level, vias, np.arange(1, round(STOP_S / period_s) + 1) * period_s, period_s)
