"""The bodies of a scene as the impact sees them: mass matrix, velocity, and how their points move.

The generalised velocity is an arm's joint velocities (7,), a box's velocity of its centre and its angular velocity (6,)
along the world's axes. `origin` (6, nv) maps it to the body's twist at the world's origin, linear first.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from hal.base.arrays import Array
from hal.pad import Pad
from hal.robots import RobotModel, robot
from hal.robots.description import FLANGE
from rtstack.impact_map.patch import Face, box_face
from rtstack.impact_map.scene import Arm, Box, ReflectedInertia, joint_inertia
from rtstack.model.arm_model import build_model, face_placement
from rtstack.model.cell_description import ArmMounting
from rtstack.model.rotation import rotation_from_quaternion

_LOWER, _DIAGONAL = np.tril_indices(7, -1), np.diag_indices(7)


@dataclass(frozen=True, slots=True)
class Body:
    """A moving body at the instant of the impact.

    M (nv, nv), velocity (nv,), origin (6, nv): see the module. place (3,) m: where its twist is told, a pad's face or a
    box's centre. robot: of an arm.
    """

    M: Array
    velocity: Array
    origin: Array
    place: Array
    robot: RobotModel | None = None

    def twist(self, velocity: Array) -> Array:
        """Return the twist (6,) m/s, rad/s at `place` for a generalised velocity (nv,)."""
        return moved_to(self.place, self.origin) @ velocity


def moved_to(point: Array, origin: Array) -> Array:
    """Return the Jacobian (6, nv) of the twist at `point`, from the one at the world's origin: v + w x p."""
    move = np.eye(6)
    move[:3, 3:] = -pin.skew(point)
    return move @ origin


def arm_body(arm: Arm, pad: Pad, reflected: ReflectedInertia) -> tuple[Body, Face]:
    """Return an arm and the face of its pad."""
    its_robot, pad = robot(arm.model), arm.pad or pad
    model, flange, face = _arm_model(arm.base_position, arm.base_orientation_wxyz, arm.model, pad)
    data = model.createData()
    q = np.array(arm.q)
    pin.crba(model, data, q, pin.Convention.WORLD)
    M = np.array(data.M)
    M[_LOWER] = M.T[_LOWER]  # crba fills the upper triangle only
    M[_DIAGONAL] += joint_inertia(reflected, its_robot)
    origin = np.array(pin.computeJointJacobians(model, data, q))
    placed = data.oMi[flange] * face
    place = placed.translation.copy()
    if arm.pad_twist is not None:
        velocity = np.linalg.lstsq(moved_to(place, origin), np.array(arm.pad_twist))[0]
    else:
        velocity = np.zeros(7) if arm.dq is None else np.array(arm.dq)
    half = np.array(pad.size[:2]) / 2
    return Body(M, velocity, origin, place, its_robot), Face(place, placed.rotation.copy(), half)


@lru_cache(maxsize=32)
def _arm_model(
    position: tuple[float, float, float], orientation: tuple[float, float, float, float], robot_model: str, pad: Pad
) -> tuple[pin.Model, int, pin.SE3]:
    """Return the arm's model, its last joint, and the pad's face in that joint's frame."""
    mounting = ArmMounting("scene", position, orientation, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), robot_model)
    model = build_model(mounting, pad)
    return model, model.frames[model.getFrameId(FLANGE)].parentJoint, face_placement(mounting, pad, model)


class BoxBody:
    """A free box: as a body, and its faces."""

    def __init__(self, box: Box) -> None:
        self._position = np.array(box.position)
        self._rotation = rotation_from_quaternion(np.array(box.orientation_wxyz))
        self._size = np.array(box.size)
        squares = self._size**2
        solid = box.mass / 12.0 * (squares.sum() - squares)
        moments = solid if box.inertia is None else np.array(box.inertia)
        M = np.zeros((6, 6))
        M[:3, :3] = box.mass * np.eye(3)
        M[3:, 3:] = (self._rotation * moments) @ self._rotation.T
        origin = np.eye(6)
        origin[:3, 3:] = pin.skew(self._position)  # v at the origin = v_c - w x c
        velocity = np.array(box.velocity + box.angular_velocity)
        self.body = Body(M, velocity, origin, self._position)

    def face(self, towards: Array) -> Face:
        """Return the face that looks most in the direction `towards` (3,)."""
        return box_face(self._position, self._rotation, self._size, towards)
