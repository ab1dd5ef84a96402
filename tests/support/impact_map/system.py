"""The oracles' own mass matrix, contact Jacobian and velocity: by other routes than the map's, from the same scene.

Mass by inverse dynamics, column by column; contact points as frames of Pinocchio's model; boxes by hand.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from rtstack.impact_map.scene import joint_inertia
from rtstack.model.arm_model import build_model
from rtstack.model.cell_description import ArmMounting

ALONG_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class System:
    """M (nv, nv), J (n, 3, nv) in the contacts' frames, v (nv,) before the impact, friction (n,)."""

    M: np.ndarray
    J: np.ndarray
    v: np.ndarray
    friction: np.ndarray

    def energy(self, v):
        """Return the kinetic energy, J."""
        return v @ self.M @ v / 2


def system_of(scene, problem):
    """Return the system of a scene, at the contact points and in the frames that the map uses."""
    nv = len(problem.velocity)
    M, v, J = np.zeros((nv, nv)), np.zeros(nv), np.zeros((len(problem.friction), 3, nv))
    for name, at in zip(problem.names, problem.slices, strict=True):
        body = _Arm(scene, name) if name in scene.arms else _Box(scene.objects[name])
        M[at, at], v[at] = body.M, body.v
        for contact, patch, points in zip(problem.contacts, problem.patches, problem.points, strict=True):
            if name in contact.between:
                sign = 1.0 if contact.between[0] == name else -1.0
                for i, point in zip(range(points.start, points.stop), patch.points, strict=True):
                    J[i, :, at] = sign * patch.frame.T @ body.jacobian(point)
    return System(M, J, v, problem.friction)


class _Arm:
    def __init__(self, scene, name):
        arm = scene.arms[name]
        mounting = ArmMounting(
            "scene", arm.base_position, arm.base_orientation_wxyz, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        )
        self.model = build_model(mounting, scene.pad)
        self.model.gravity.setZero()
        data = self.model.createData()
        self.q = np.array(arm.q)
        columns = [pin.rnea(self.model, data, self.q, np.zeros(7), unit) for unit in np.eye(7)]
        self.M = np.column_stack(columns) + np.diag(joint_inertia(scene.reflected))
        pin.forwardKinematics(self.model, data, self.q)
        self.joint = data.oMi[7].copy()
        flange = self.model.frames[self.model.getFrameId("link8")].placement
        face = flange.act(np.array([0.0, 0.0, scene.pad.flange_to_face]))
        if arm.pad_twist is not None:
            self.v = np.linalg.pinv(self._jacobian(face)) @ np.array(arm.pad_twist)
        else:
            self.v = np.zeros(7) if arm.dq is None else np.array(arm.dq)

    def jacobian(self, point):
        """Return the Jacobian (3, 7) of a point of the hand, given in the world."""
        return self._jacobian(self.joint.actInv(point))[:3]

    def _jacobian(self, local):
        placement = pin.SE3(np.eye(3), local)
        frame = self.model.addFrame(pin.Frame(f"at{self.model.nframes}", 7, placement, pin.FrameType.OP_FRAME))
        data = self.model.createData()
        pin.computeJointJacobians(self.model, data, self.q)
        pin.updateFramePlacements(self.model, data)
        return pin.getFrameJacobian(self.model, data, frame, ALONG_WORLD)


class _Box:
    def __init__(self, box):
        w, *xyz = box.orientation_wxyz
        rotation = Rotation.from_quat([*xyz, w]).as_matrix()
        a, b, c = box.size
        moments = box.inertia or [box.mass / 12 * s for s in (b * b + c * c, a * a + c * c, a * a + b * b)]
        self.M = np.zeros((6, 6))
        self.M[:3, :3] = box.mass * np.eye(3)
        self.M[3:, 3:] = rotation @ np.diag(moments) @ rotation.T
        self.v = np.array([*box.velocity, *box.angular_velocity])
        self.centre = np.array(box.position)

    def jacobian(self, point):
        """Return the Jacobian (3, 6) of a point, given in the world: v + w x r = v - r x w."""
        return np.hstack([np.eye(3), -pin.skew(point - self.centre)])
