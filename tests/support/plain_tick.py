"""The tick in plain numpy, written from the equations: the oracle of the compiled one.

It shares nothing with the compiled tick but Pinocchio's model and the QP solver. Its limits, too, are its own: the
vendor's published numbers and the margins of docs/limits.md, written here a second time.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from hal.base.arrays import Array
from rtstack.control.parameters import ControlParameters, DetectorParameters, FrictionParameters, InertiaParameters
from rtstack.control.program import Program, program
from rtstack.model.arm_model import ArmModel
from rtstack.samples import QpSolver, QpStatus


class PlainLimits:
    """The controller's lines for a Franka Research 3, (7,) each, in a cell whose table `[safety]` is `safety`."""

    def __init__(self, safety: Mapping[str, Any] | None = None) -> None:
        # robot specification, "Limits for Franka Research 3", system version >= 5.9; torque rate: libfranka
        vendor_dq_max = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
        judge = {
            "q_lower": np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]) + 0.005,
            "q_upper": np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]) - 0.005,
            "dq_max": 0.98 * vendor_dq_max,
            "tau_max": np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
            "tau_J_max": np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
            "tau_rate_max": np.array(1000.0),
        }
        judge |= {name: np.array(value, float) for name, value in (safety or {}).items() if name in judge}
        margin = np.minimum(0.02 * vendor_dq_max, judge["dq_max"] / 2)
        self.q_lower, self.q_upper = judge["q_lower"], judge["q_upper"]
        self.dq_max = judge["dq_max"] - margin
        self.offset = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]) + margin
        self.deceleration = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
        self.braking = np.array([10.0, 10.0, 10.0, 10.0, 17.0, 10.0, 17.0])
        self.tau_max, self.tau_J_max = 0.999 * judge["tau_max"], 0.9 * judge["tau_J_max"]
        self.tau_rate_max = float(judge["tau_rate_max"])

    def acceleration(self, room: Array, speed: Array) -> Array:
        """Return the largest acceleration towards a position limit, `room` rad before it, at `speed` (12)-(13)."""
        root = np.sqrt(2.0 * self.deceleration * np.maximum(room, 0.0))
        tangent = self.deceleration / self.offset * room - self.offset / 2
        allowed = np.where(tangent > 0.0, root - self.offset, tangent)
        slope = np.where(tangent > 0.0, self.deceleration / np.maximum(root, 1e-9), self.deceleration / self.offset)
        braked = (allowed - speed) / 0.02 - slope * speed
        return np.maximum(np.minimum(braked, (self.dq_max - speed) / 0.02), -self.braking)


@dataclass(frozen=True, slots=True)
class PlainOutput:
    """What the tick says: torque (7,), wrench (6,), posture acceleration, residual (7,), impact, QP status."""

    tau_desired: Array
    wrench_desired: Array
    beta: float
    momentum_residual: Array
    impact: bool
    status: QpStatus


class PlainArm:
    """One arm's tick, with its observer, detector and last torque."""

    def __init__(
        self,
        model: ArmModel,
        control: ControlParameters | None = None,
        detector: DetectorParameters | None = None,
        inertia: InertiaParameters | None = None,
        friction: FrictionParameters | None = None,
        solver: QpSolver = QpSolver.PROXQP,
        safety: Mapping[str, Any] | None = None,
    ) -> None:
        self._pin = model.pin_model
        self._data = self._pin.createData()
        self._face = pin.SE3(model.R_joint_ee, model.face)
        self._R_world_base = model.T_world_base[:3, :3]
        self._p = control or ControlParameters()
        self._detector = detector or DetectorParameters()
        self._inertia = inertia or InertiaParameters()
        self._friction = friction or FrictionParameters()
        self._program: Program = program(solver)
        self._history: deque[tuple[float, Array]] = deque(maxlen=round(self._detector.window_s / self._p.period_s))
        self._integral: Array | None = None
        self._r = np.zeros(7)
        self.tau_previous = np.zeros(7)
        self.limits = PlainLimits(safety)

    def tick(self, state: Any, setpoint: Any) -> PlainOutput:
        """Compute the torque. state: has q, dq, tau_J (7,) and O_F_ext_hat_K (6,); setpoint: the fields of SETPOINT."""
        q, dq = state.q, state.dq
        dt = self._p.period_s
        pin.computeCoriolisMatrix(self._pin, self._data, q, dq)
        M_links = pin.crba(self._pin, self._data, q, pin.Convention.WORLD)
        M_links = np.triu(M_links) + np.triu(M_links, 1).T
        g = pin.computeGeneralizedGravity(self._pin, self._data, q)
        C = self._data.C
        J, dJdq, T_world_ee = self._kinematics(dq)
        twist = J @ dq
        M = M_links + np.diag(self._inertia.added)
        f = self._friction
        friction = f.scale * (f.p1 / (1.0 + np.exp(-f.p2 * (dq + f.p3))) - f.p1 / (1.0 + np.exp(-f.p2 * f.p3)))
        friction = friction + f.gravity_share * g
        residual = self._observe(M_links, C, g, state, dt)
        impact = self._detect(-self._R_world_base @ state.O_F_ext_hat_K[:3], twist[:3])

        Lambda_inverse = J @ np.linalg.solve(M, J.T)  # (8)
        eigenvalues, V = np.linalg.eigh(Lambda_inverse)
        sqrt_Lambda = V @ np.diag(1.0 / np.sqrt(eigenvalues)) @ V.T
        sqrt_K = np.diag(np.sqrt(setpoint.stiffness))
        D = sqrt_Lambda @ sqrt_K + sqrt_K @ sqrt_Lambda  # (7)
        R = T_world_ee.rotation
        error = np.concatenate([setpoint.position - T_world_ee.translation, R @ pin.log3(R.T @ setpoint.rotation)])
        if self._p.acceleration_tasks:  # (15)-(16) of the impact-map paper
            k_task = setpoint.stiffness
            sqrt_K, D = np.diag(np.sqrt(k_task)), np.linalg.inv(Lambda_inverse) @ np.diag(2.0 * np.sqrt(k_task))
            error = np.linalg.solve(Lambda_inverse, k_task * error) / k_task
        wrench = (
            setpoint.wrench_ff + setpoint.velocity_weight * (D @ (setpoint.twist - twist)) + setpoint.stiffness * error
        )  # (5), (22), (27)
        joint = self._p.posture_joint
        k = setpoint.posture_gain
        beta = (
            setpoint.beta
            + 2.0 * np.sqrt(k) * setpoint.velocity_weight * (setpoint.dxi - dq[joint])
            + k * (setpoint.xi - q[joint])
        )  # (10), (24), (31)

        w_imp, w_pos = self._p.weight_impedance, self._p.weight_posture
        S = np.eye(7)[joint]
        b = Lambda_inverse @ wrench - dJdq
        H = w_imp * J.T @ J + w_pos * np.outer(S, S) + self._p.regularisation * np.eye(7)
        gradient = -w_imp * J.T @ b - w_pos * beta * S
        push = np.linalg.solve(M, -residual)
        ddq, status = self._minimise(H, gradient, q, dq, push, M, C @ dq + friction, g)
        if status in (QpStatus.UNCONSTRAINED, QpStatus.SOLVED):
            tau = M @ ddq + C @ dq + friction  # (4), gravity excluded
            step = self.limits.tau_rate_max * dt * (1.0 - 2e-4)
            tau = np.clip(tau, self.tau_previous - step, self.tau_previous + step)
        else:
            tau = self.tau_previous
        return PlainOutput(tau, wrench, float(beta), residual, impact, status)

    def _kinematics(self, dq: Array) -> tuple[Array, Array, pin.SE3]:
        T_world_ee = self._data.oMi[7] * self._face
        p = T_world_ee.translation
        # from the world's origin to the end effector, axes unchanged
        X = np.block([[np.eye(3), -pin.skew(p)], [np.zeros((3, 3)), np.eye(3)]])
        J = X @ self._data.J
        v = J @ dq
        a = X @ (self._data.dJ @ dq)
        a[:3] += np.cross(v[3:], v[:3])
        return J, a, T_world_ee

    def _observe(self, M: Array, C: Array, g: Array, state: Any, dt: float) -> Array:
        p = M @ state.dq
        driven, gain = state.tau_J - g + C.T @ state.dq, self._inertia.observer_gain_hz
        if self._integral is None:
            self._integral = p + driven / gain
        else:
            self._integral = self._integral + (driven + self._r) * dt
        self._r = gain * (p - self._integral)
        return -self._r

    def _detect(self, force: Array, velocity: Array) -> bool:
        d = self._detector
        norm = float(np.linalg.norm(force))
        hit = False
        if len(self._history) == self._history.maxlen:
            past_norm, past_velocity = self._history[0]
            hit = bool(
                past_norm < d.force_low_n and norm > d.force_high_n and past_velocity @ force < -d.velocity_m_s * norm
            )
        self._history.append((norm, velocity.copy()))
        return hit

    def _minimise(
        self, H: Array, gradient: Array, q: Array, dq: Array, push: Array, M: Array, motion: Array, g: Array
    ) -> tuple[Array, QpStatus]:
        limits = self.limits
        high, low = limits.acceleration(limits.q_upper - q, dq), -limits.acceleration(q - limits.q_lower, -dq)
        upper = np.maximum(high - np.clip(push, 0.0, 2.0 * limits.braking), low)
        lower = np.minimum(low - np.clip(push, -2.0 * limits.braking, 0.0), high)
        tau_upper = np.minimum(limits.tau_max, limits.tau_J_max - g) - motion  # (14)
        tau_lower = np.maximum(-limits.tau_max, -limits.tau_J_max - g) - motion
        ddq = np.linalg.solve(H, -gradient)
        tau = M @ ddq
        inside = np.all(ddq <= upper) and np.all(ddq >= lower) and np.all(tau <= tau_upper) and np.all(tau >= tau_lower)
        if inside:
            return ddq, QpStatus.UNCONSTRAINED
        ddq = np.zeros(7)
        status, _ = self._program.solve(H, gradient, lower, upper, M, tau_lower, tau_upper, ddq)
        return ddq, status
