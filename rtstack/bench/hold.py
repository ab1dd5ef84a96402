"""A soft hold of one arm under its judge: finds a robot that does not carry its own weight (falls at 2.9 rad/s)."""

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError
from hal.limits import CONTROL_PERIOD_S
from hal.state import ARM_STATE, ArmState
from rtstack.control.joint_law import DAMPING, STIFFNESS
from rtstack.safety.judge import ForcePhase, SafetyJudge
from rtstack.safety.limits import SafetyLimits
from rtstack.samples import ARM_SAMPLE

# Ours: at 0.01 rad the hold gives 3 Nm at the base, what a tool of 0.4 kg takes that the robot was not told of.
# Simulated arms whose gravity torque is off by 0.5 % stay within 0.0006 rad and 0.006 rad/s; by 5 %, ten times that
STILL_RAD = 0.01
STILL_RAD_S = 0.2
GOOD_RAD = 0.5 * STILL_RAD
STEP_SHARE = 0.5  # of the torque rate at which the robot stops
SETTLED = 100  # ticks until the estimate is taken: the hold has come to rest


class ArmMoved(HardwareError):
    """An arm did not stay where it was held, or its judge stopped it."""


class HoldEnded(HardwareError):
    """The hold was ended before its time: the key was let go, or a stop was asked for."""


class Hold:
    """Holds an arm where its first state showed it. rad, rad_s, nm: the most that was seen of any joint."""

    def __init__(self, side: str, judge: SafetyJudge, limits: SafetyLimits, ticks: int) -> None:
        """side: how a message calls the arm; ticks: how many are kept as `samples`."""
        self._side, self._judge = side, judge
        self._q = np.zeros(7)
        self._count = 0
        self._kept = np.zeros(ticks, ARM_SAMPLE)
        self._kept.view(np.uint8).fill(0)  # each page is touched before the arm waits for an answer
        self._tau_max = np.array(limits.tau_max)
        self._step = STEP_SHARE * limits.tau_rate_max * CONTROL_PERIOD_S
        self._sample = np.zeros(1, ARM_SAMPLE)
        self._state = self._sample.view(np.uint8)[: ARM_STATE.itemsize]
        self._wanted, self._applied = self._sample["tau_desired"][0], self._sample["tau_applied"][0]
        judge.expect(ForcePhase.APPROACH)
        self._residual = np.zeros(7)  # there is no observer
        self.rad = self.rad_s = self.nm = 0.0

    @property
    def samples(self) -> NDArray[np.void]:
        """The samples (n,) of ARM_SAMPLE that were kept."""
        return self._kept[: self._count]

    @property
    def estimate(self) -> NDArray[np.float64]:
        """External torques (7,), Nm, and wrench (6,) in the base, N and Nm, of each settled tick, (n, 13)."""
        settled = self._kept[min(SETTLED, self._count // 2) : self._count]
        return np.hstack([settled["tau_ext_hat_filtered"], settled["O_F_ext_hat_K"]])

    def torque(self, state: ArmState) -> NDArray[np.float64]:
        """Return the torque (7,), Nm, that answers a state. Raises ArmMoved where the arm has not stayed."""
        if self._count == 0:
            self._q[:] = state.q
        dq = state.record["dq"][0]
        off = self._q - state.q
        self._look(np.abs(off), np.abs(dq))
        self._state[:] = state.record.view(np.uint8)
        wanted = np.clip(STIFFNESS * off - DAMPING * dq, -self._tau_max, self._tau_max)
        self._wanted += np.clip(wanted - self._wanted, -self._step, self._step)
        self._judge.judge(self._sample, residual=self._residual)
        if self._count < len(self._kept):
            self._kept[self._count] = self._sample[0]
            self._count += 1
        if self._judge.stopping:
            raise ArmMoved(f"the {self._side} arm was stopped by its judge: {self._judge.explanation}")
        self.nm = max(self.nm, float(np.abs(self._applied).max()))
        return self._applied

    def _look(self, away: NDArray[np.float64], fast: NDArray[np.float64]) -> None:
        self.rad, self.rad_s = max(self.rad, float(away.max())), max(self.rad_s, float(fast.max()))
        if self.rad <= STILL_RAD and self.rad_s <= STILL_RAD_S:  # false where a state is no number
            return
        share = np.maximum(away / STILL_RAD, fast / STILL_RAD_S)
        joint = int(np.argmax(np.nan_to_num(share, nan=np.inf)))
        raise ArmMoved(
            f"joint {joint + 1} of the {self._side} arm moved {away[joint]:.3f} rad at {fast[joint]:.2f} rad/s, "
            f"although it was held with {abs(self._applied[joint]):.1f} Nm"
        )
