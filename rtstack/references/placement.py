"""Carries an object gently: hold it between both pads, lift, carry and turn it, set it down, let go, go back.

No impact: the pads close at CLOSING_M_S, and press as hard as friction needs, with a margin.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.displacement import Displacement
from rtstack.control.records import POINT
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ObjectDescription, Table
from rtstack.references.demonstration import end_effector_pose, turn_to_object
from rtstack.references.quintic import ViaPoint, quintic_path

GRAVITY_M_S2 = 9.81
GRIP = 2.5  # times the least force m g / (2 mu) that friction needs: bodies that are carried shake
CLOSING_M_S = 0.03  # 20 N on rice_box at the impact-free speed; a grab hits at 0.35
FREE_M_S, CARRY_M_S, TURN_RAD_S = 0.20, 0.10, 0.5  # means; a quintic's peak is 15/8 of its mean
STAND_OFF_M = 0.05
LIFT_M, LIFT_S, REST_S = 0.03, 1.0, 0.3
ROOM_RAD = 0.05  # to a joint's limit
WAY, NEWTON_STEPS = 12, 3


@dataclass(frozen=True, slots=True)
class _Grip:
    """Where the middle between both pads' faces is, (3,) m, turned about z by yaw, rad; half the gap, m."""

    centre: Array
    yaw: float
    gap: float


def carried(
    models: tuple[ArmModel, ArmModel], homes: Array, thing: ObjectDescription, table: Table, *,
    stands: Displacement, wanted: Displacement, pad_friction: float, stiffness_n_m: float, period_s: float,
) -> NDArray:  # fmt: skip
    """Return target frames, (2, n) of POINT, one a tick, for arms that start at `homes` (2, 7) rad and end there.

    stands, wanted: of the object, from its nominal place. stiffness_n_m: of a pad, towards the object. Raises
    ValueError where a joint would come nearer than ROOM_RAD to its limit.
    """
    from scipy.spatial.transform import Rotation  # half a second, which most programs need not spend

    poses = [end_effector_pose(model, q) for model, q in zip(models, homes, strict=True)]
    lowest = min(position[2] for position, _ in poses)  # at home the pads are just clear of the table
    height = max(table.top_z + thing.size[2] / 2.0, lowest)
    force = GRIP * thing.mass * GRAVITY_M_S2 / (2.0 * pad_friction)
    half = thing.size[1] / 2.0
    closed, apart = half - force / stiffness_n_m, half + STAND_OFF_M
    here, there = np.array([stands.x_m, stands.y_m, height]), np.array([wanted.x_m, wanted.y_m, height])
    up = np.array([0.0, 0.0, LIFT_M])
    turn = wanted.yaw_rad - stands.yaw_rad
    carry_s = max(1.0, float(np.linalg.norm(there - here)) / CARRY_M_S, abs(turn) / TURN_RAD_S)
    close_s = (apart - closed) / CLOSING_M_S
    held, put = _Grip(here, stands.yaw_rad, closed), _Grip(there, wanted.yaw_rad, closed)
    steps = [
        (0.0, replace(held, gap=apart)), (close_s, held), (REST_S, held), (LIFT_S, replace(held, centre=here + up)),
        (carry_s, replace(put, centre=there + up)), (LIFT_S, put), (REST_S, put), (close_s, replace(put, gap=apart)),
    ]  # fmt: skip
    sides = [float(np.sign(position[1])) for position, _ in poses]
    for model, home, side, (_, rotation) in zip(models, homes, sides, poses, strict=True):
        for grip in (steps[0][1], steps[-1][1]):
            turned = Rotation.from_rotvec([0.0, 0.0, grip.yaw]) * Rotation.from_rotvec(turn_to_object(rotation, -side))
            joint, room = _nearest_limit(model, home, _place(grip, side), turned.as_matrix() @ rotation)
            if room < ROOM_RAD:
                (x_mm, y_mm), yaw_deg = 1e3 * grip.centre[:2], np.degrees(grip.yaw)
                what = f"joint {joint + 1} of the {'left' if side > 0.0 else 'right'} arm would be at its limit"
                raise ValueError(f"at x {x_mm:.0f}, y {y_mm:.0f} mm, turned by {yaw_deg:.0f} degrees, {what}")
    ways = [
        np.linalg.norm(position - _place(grip, side))
        for (position, _), side in zip(poses, sides, strict=True) for grip in (steps[0][1], steps[-1][1])
    ]  # fmt: skip
    reach_s = max(1.0, float(max(ways)) / FREE_M_S)
    ends = REST_S + reach_s + np.cumsum([seconds for seconds, _ in steps])
    t = np.arange(round((ends[-1] + reach_s + REST_S) / period_s)) * period_s
    near, _ = quintic_path(
        [ViaPoint(REST_S, 0.0), ViaPoint(ends[0], 1.0), ViaPoint(ends[-1], 1.0), ViaPoint(ends[-1] + reach_s, 0.0)], t
    )
    grips = [grip for _, grip in steps]
    centre = np.stack([_through(ends, [grip.centre[axis] for grip in grips], t) for axis in range(3)], axis=-1)
    yaw, gap = (_through(ends, [getattr(grip, name) for grip in grips], t) for name in ("yaw", "gap"))
    targets = np.zeros((2, len(t)), POINT)
    for arm, (position, rotation) in enumerate(poses):
        out = sides[arm] * np.stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)], axis=-1)
        where = centre + gap[:, None] * out
        targets[arm]["position"] = position + near[:, None] * (where - position)
        facing = Rotation.from_rotvec(near[:, None] * turn_to_object(rotation, -sides[arm]))
        about_z = Rotation.from_rotvec(np.outer(near * yaw, [0.0, 0.0, 1.0]))
        turned = about_z * facing
        targets[arm]["rotation"] = turned.as_matrix() @ rotation
        targets[arm]["twist"][:, :3] = np.gradient(targets[arm]["position"], period_s, axis=0)
        targets[arm]["twist"][:-1, 3:] = (turned[1:] * turned[:-1].inv()).as_rotvec() / period_s
        targets[arm]["xi"] = homes[arm, 0]
    return targets


def _place(grip: _Grip, side: float) -> Array:
    """Return where the face of a pad is, (3,) m. side: 1 for the pad on the object's +y side, else -1."""
    return grip.centre + side * grip.gap * np.array([-np.sin(grip.yaw), np.cos(grip.yaw), 0.0])


def _nearest_limit(model: ArmModel, home: Array, position: Array, rotation: Array) -> tuple[int, float]:
    """Return which joint comes nearest to a limit, and how near, rad, on a straight way of the pad's face from home to
    position (3,) m, rotation (3, 3). Joint 1, the posture, stays at home. Newton's method."""
    from scipy.spatial.transform import Rotation  # half a second, which most programs need not spend

    limits, (start, R_start) = model.robot.limits, end_effector_pose(model, home)
    lower, upper = np.array(limits.q_lower), np.array(limits.q_upper)
    turn = Rotation.from_matrix(rotation @ R_start.T).as_rotvec()
    q, room = home.copy(), np.full(7, np.inf)
    error = np.zeros(6)
    for share in np.linspace(0.0, 1.0, WAY):
        wanted = Rotation.from_rotvec(share * turn).as_matrix() @ R_start
        for _ in range(NEWTON_STEPS):
            at, R = end_effector_pose(model, q)
            jacobian = np.array(model.J0)
            jacobian[:3] += np.cross(model.J0[3:].T, at).T  # from the world's origin to the face
            error[:3] = start + share * (position - start) - at
            error[3:] = Rotation.from_matrix(wanted @ R.T).as_rotvec()
            q[1:] += np.linalg.lstsq(jacobian[:, 1:], error, rcond=1e-3)[0]
        room = np.minimum(room, np.minimum(q - lower, upper - q))
    return int(room.argmin()), float(room.min())


def _through(ends: Array, values: list[float], t: Array) -> Array:
    """Return the coordinate (n,) that rests at each value at its time."""
    points = [ViaPoint(float(ends[0]), values[0])]
    points += [ViaPoint(float(end), value) for end, value in zip(ends[1:], values[1:], strict=True)]
    return quintic_path(points, t)[0]
