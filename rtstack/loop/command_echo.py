"""The robot's report of the commanded torque, compared with the torque that was sent."""

import numpy as np

from hal.compilation import bound, compiled
from rtstack.control.controller import ObservedArm
from rtstack.control.observation import remember_torque
from rtstack.safety.judge import SafetyJudge

SAME_TORQUE_NM = 1e-3  # the wire rounds to float32: 4e-6 Nm at 87 Nm


@compiled
def largest_difference(tau_J_d, tau_applied):
    """Return the largest difference of two torques (7,), Nm; NaN where one of them is no number."""
    largest = 0.0
    for i in range(7):
        difference = abs(tau_J_d[i] - tau_applied[i])
        if not difference <= largest:
            largest = difference
            if difference != difference:
                return difference
    return largest


class CommandEcho:
    """Where an arm's next torque starts from. `lost`: answers that came too late; `seen`: one of ours has come back."""

    def __init__(self, judge: SafetyJudge, arm: ObservedArm) -> None:
        sample = arm.sample[0]
        self._judged = judge.memory["tau_applied"][0]  # what the judge let through last
        self._tau_J_d = sample["tau_J_d"]
        self._desired = sample["tau_desired"]
        self._previous = arm.workspace["tau_previous"][0]  # what the controller starts from
        self._differ = bound(largest_difference, self._tau_J_d, self._judged)
        # of the state that was judged last: a new one never has the same seven torques
        self._changes = bound(largest_difference, sample["tau_J"], judge.memory["tau_J"][0])
        self._desires = bound(largest_difference, self._tau_J_d, np.zeros(7))
        self._remember = bound(remember_torque, sample["tau_applied"], self._previous)
        self.seen = False
        self.lost = 0

    def agree(self, begun: bool) -> None:
        """Start from the torque that the robot has: an answer that came too late was dropped. A state that repeats the
        last one tells nothing of it. Until our first torque has come back we start from zero: tau_J_d is what the
        robot's own controller held the arm with. begun: the arm has shown a state before this one."""
        difference = self._differ()
        if not SAME_TORQUE_NM < difference < np.inf:  # the same, or no number at all
            self.seen = self.seen or (begun and self._desires() > SAME_TORQUE_NM)
            return
        if self.seen and self._changes() == 0.0:
            return
        self.lost += begun
        if self.seen:
            self._judged[:] = self._previous[:] = self._tau_J_d
        else:
            self._judged[:] = self._previous[:] = 0.0

    def sent(self) -> None:
        """Remember what the judge let through."""
        self._remember()

    def desire_nothing_new(self) -> None:
        """Desire the last torque: the controller is not called."""
        self._desired[:] = self._previous
