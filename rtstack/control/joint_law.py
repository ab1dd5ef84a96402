"""The law of an arm that follows a path of its joints: a spring and a damper in each, beside what moves the arm.

tau = K (q_ref - q) + D (dq_ref - dq) + C dq + friction(dq_ref), gravity excluded: libfranka's
joint_impedance_control.cpp, and what friction takes at the velocity that is asked for.
"""

import numpy as np

from hal.base.arrays import Array
from hal.compilation import bound, compiled
from rtstack.control.controller import ArmLaw, ObservedArm
from rtstack.control.observation import friction_torque
from rtstack.control.parameters import FrictionParameters
from rtstack.samples import Mode, QpStatus

# Nm/rad and Nms/rad: half of what that example takes, less at the wrist, whose motors other simulators make lighter
STIFFNESS = np.array([300.0, 300.0, 300.0, 300.0, 100.0, 100.0, 30.0])
DAMPING = np.array([30.0, 30.0, 30.0, 30.0, 8.0, 8.0, 2.0])
_PERIOD_NS = 1_000_000


@compiled
def follow_joints(samples, workspaces, limits, q_ref, dq_ref, friction, began_ns):
    """Write tau_desired (7,), Nm, at most a step away from the last applied torque. q_ref, dq_ref, friction (n, 7): a
    row a millisecond from the first call on; began_ns (1,): the time of that, negative before it."""
    sample, work, limit = samples[0], workspaces[0], limits[0]
    if began_ns[0] < 0:
        began_ns[0] = sample["t_ns"]
    row = min((sample["t_ns"] - began_ns[0]) // _PERIOD_NS, q_ref.shape[0] - 1)
    for i in range(7):
        tau = STIFFNESS[i] * (q_ref[row, i] - sample["q"][i]) + DAMPING[i] * (dq_ref[row, i] - sample["dq"][i])
        tau += work["coriolis"][i] + friction[row, i]
        most, last = limit["tau_max"][i], work["tau_previous"][i]
        tau = min(max(tau, -most), most)
        sample["tau_desired"][i] = min(max(tau, last - limit["tau_step"]), last + limit["tau_step"])


class JointLaw(ArmLaw):
    """The ArmLaw of an arm along a path of its joints q (n, 7), rad, dq (n, 7), rad/s, which it holds at its end."""

    def __init__(self, arm: ObservedArm, q: Array, dq: Array, friction: FrictionParameters) -> None:
        """Compile it, before a clock runs."""
        self._began_ns = np.full(1, -1)
        rows = np.ascontiguousarray(q), np.ascontiguousarray(dq), np.zeros(q.shape)
        for speed, torque in zip(rows[1], rows[2], strict=True):
            friction_torque(speed, friction.p1, friction.p2, friction.p3, friction.scale, torque)
        self._follow = bound(follow_joints, arm.sample, arm.workspace, arm.limits, *rows, self._began_ns)
        before = arm.sample.copy()
        self._follow()
        arm.sample[:] = before
        self._began_ns[0] = -1

    def command(self, mode: Mode) -> QpStatus:
        self._follow()
        return QpStatus.NOT_USED
