"""A soft hold of one arm, and the judgement whether it stays: a robot that does not carry its own weight is found here.

With no torque at all such an arm falls or rises, at 2.9 rad/s on another author's robot.
"""

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError
from hal.limits import CONTROL_PERIOD_S
from hal.robots import FR3
from hal.state import ArmState

# Nm/rad and Nms/rad. Half of what libfranka's joint_impedance_control.cpp takes, less at the wrist: a hold must not
# shake an arm whose motors are lighter than the vendor's, as other simulators' are
STIFFNESS = np.array([300.0, 300.0, 300.0, 300.0, 100.0, 100.0, 30.0])
DAMPING = np.array([30.0, 30.0, 30.0, 30.0, 8.0, 8.0, 2.0])
# Ours: at 0.01 rad the hold gives 3 Nm at the base, what a tool of 0.4 kg takes that the robot was not told of.
# Simulated arms whose gravity torque is off by 0.5 % stay within 0.0006 rad and 0.006 rad/s; by 5 %, ten times that
STILL_RAD = 0.01
STILL_RAD_S = 0.2
GOOD_RAD = 0.5 * STILL_RAD
LIMITS = FR3.limits  # a link is timed without a cell's file: the default model's
STEP_NM = 0.5 * LIMITS.tau_rate_max * CONTROL_PERIOD_S  # a tick: half of the torque rate at which the robot stops


class ArmMoved(HardwareError):
    """An arm did not stay where it was held."""


class Hold:
    """Holds an arm where its first state showed it. rad, rad_s, nm: the most that was seen of any joint."""

    def __init__(self, side: str) -> None:
        """side: how a message calls the arm."""
        self._side = side
        self._q = np.zeros(7)
        self._begun = False
        self._tau = np.zeros(7)
        self.rad = self.rad_s = self.nm = 0.0

    def torque(self, state: ArmState) -> NDArray[np.float64]:
        """Return the torque (7,), Nm, that answers a state. Raises ArmMoved where the arm has not stayed."""
        if not self._begun:
            self._q[:], self._begun = state.q, True
        dq = state.record["dq"][0]
        off = self._q - state.q
        self._judge(np.abs(off), np.abs(dq))
        wanted = np.clip(STIFFNESS * off - DAMPING * dq, -LIMITS.tau_max, LIMITS.tau_max)
        self._tau += np.clip(wanted - self._tau, -STEP_NM, STEP_NM)
        self.nm = max(self.nm, float(np.abs(self._tau).max()))
        return self._tau

    def _judge(self, away: NDArray[np.float64], fast: NDArray[np.float64]) -> None:
        self.rad, self.rad_s = max(self.rad, float(away.max())), max(self.rad_s, float(fast.max()))
        if self.rad <= STILL_RAD and self.rad_s <= STILL_RAD_S:  # false where a state is no number
            return
        share = np.maximum(away / STILL_RAD, fast / STILL_RAD_S)
        joint = int(np.argmax(np.nan_to_num(share, nan=np.inf)))
        raise ArmMoved(
            f"joint {joint + 1} of the {self._side} arm moved {away[joint]:.3f} rad at {fast[joint]:.2f} rad/s, "
            f"although it was held with {abs(self._tau[joint]):.1f} Nm"
        )
