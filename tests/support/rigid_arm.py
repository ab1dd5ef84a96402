"""The test's own model of the arm (Pinocchio), independent of the plant's, with the pad on its flange."""

import numpy as np
import pinocchio as pin

from hal.robots import FR3
from sim_robot.scene import Pad


class RigidArm:
    """Rigid dynamics and the kinematics of the pad's face, in the arm's base frame (axes of the world here)."""

    def __init__(self, pad: Pad) -> None:
        self.model = pin.buildModelFromXML(FR3.urdf)
        link8 = self.model.frames[self.model.getFrameId("link8")]
        face = link8.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, pad.flange_to_face]))
        centre = link8.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, pad.flange_to_face - pad.size[2] / 2.0]))
        self.model.appendBodyToJoint(7, pin.Inertia.FromBox(pad.mass, *pad.size), centre)
        self._face = self.model.addFrame(
            pin.Frame("face", link8.parentJoint, link8.parentFrame, face, pin.FrameType.OP_FRAME)
        )
        self.data = self.model.createData()

    def pose(self, q: np.ndarray) -> pin.SE3:
        """Pose of the pad's face in the base."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self._face].copy()

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian (6, 7) of the pad's face, linear first, along the base's axes."""
        return pin.computeFrameJacobian(self.model, self.data, q, self._face, pin.LOCAL_WORLD_ALIGNED)

    def acceleration(self, q: np.ndarray, dq: np.ndarray, tau: np.ndarray, B_theta: np.ndarray) -> np.ndarray:
        """(M + B_theta)^-1 (tau - C dq), gravity compensated: (10) of the impact-map paper."""
        M = pin.crba(self.model, self.data, q, pin.Convention.WORLD)
        M = np.triu(M) + np.triu(M, 1).T
        bias = pin.nonLinearEffects(self.model, self.data, q, dq)
        bias = bias - pin.computeGeneralizedGravity(self.model, self.data, q)
        return np.linalg.solve(M + np.diag(B_theta), tau - bias)
