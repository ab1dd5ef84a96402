"""A controller that is no mode strategy of rtstack: joint impedance, without a QP.

The pads' references become joint references by damped inverse kinematics, and springs and dampers at the joints follow
them: tau = K (q_ref - q) + D (dq_ref - dq) + J^T f_ff + C dq + friction.
"""

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.control.controller import ObservedArm
from rtstack.control.modes import Strategy
from rtstack.control.tick import CellController
from rtstack.samples import Mode, QpStatus
from rtstack.trials.assembly import ControllerRequest

STIFFNESS = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])  # Nm/rad, libfranka's example
DAMPING = np.array([50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0])  # Nms/rad
CORRECTION = 10.0  # 1/s: how fast the joint references make up for an error of the pose
REGULARISATION = 1e-3  # of the inverse kinematics, (m/rad)^2


def joint_tracking(request: ControllerRequest) -> CellController:
    """Return the controller for a session. References change at the nominal impact, by time."""
    left, right = request.arms
    modes = request.modes(Strategy.NO_REFERENCE_SPREADING)
    return request.pair(modes, (JointTracking(left), JointTracking(right)))


class JointTracking:
    """The torque of one arm: an rtstack.control.controller.ArmLaw."""

    def __init__(self, arm: ObservedArm) -> None:
        self._period_s, self._tau_step = arm.parameters.period_s, float(arm.limits["tau_step"][0])
        self._q, self._dq, self._tau_desired = _views(arm.sample, "q", "dq", "tau_desired")
        self._position, self._rotation, self._J = _views(arm.workspace, "position", "rotation", "J")
        self._coriolis, self._friction, self._last = _views(arm.workspace, "coriolis", "friction", "tau_previous")
        self._position_ref, self._rotation_ref = _views(arm.setpoint, "position", "rotation")
        self._twist_ref, self._wrench_ff = _views(arm.setpoint, "twist", "wrench_ff")
        (self._wrench_desired,) = _views(arm.control, "wrench_desired")
        self._q_ref: Array = np.zeros(7)
        self._begun = False

    def follow(self, ante: NDArray[np.void], post: NDArray[np.void]) -> None:
        """Begin anew: at the joints of the first state."""
        self._begun = False

    def observe(self) -> None:
        """Take the joints that the arm begins with."""
        if not self._begun:
            self._q_ref[:] = self._q
            self._begun = True

    def command(self, mode: Mode) -> QpStatus:
        """Write tau_desired."""
        turn = 0.5 * np.cross(self._rotation, self._rotation_ref, axis=0).sum(axis=1)
        error = np.concatenate([self._position_ref - self._position, turn])
        J = self._J
        wanted = self._twist_ref + CORRECTION * error
        dq_ref: Array = J.T @ np.linalg.solve(J @ J.T + REGULARISATION * np.eye(6), wanted)
        self._q_ref += dq_ref * self._period_s
        feedback: Array = STIFFNESS * (self._q_ref - self._q) + DAMPING * (dq_ref - self._dq)
        tau: Array = feedback + J.T @ self._wrench_ff + self._coriolis + self._friction
        self._tau_desired[:] = np.clip(tau, self._last - self._tau_step, self._last + self._tau_step)
        self._wrench_desired[:] = np.linalg.solve(J @ J.T + REGULARISATION * np.eye(6), J @ feedback) + self._wrench_ff
        return QpStatus.NOT_USED


def _views(record: NDArray[np.void], *names: str) -> list[Array]:
    """Return views of fields of a record (1,): they are looked up once, and stay where they are."""
    return [record[0][name] for name in names]
