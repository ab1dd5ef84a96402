"""The safety judge at the end of the tick: it sees a state and a desired torque, and answers pass, limit or stop.

A stop latches until it is recovered from. The judge imports the hardware contract only, computes where the arm is from
hal's own description, and allocates, logs, waits and raises nowhere in `judge`.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hal.compilation import bound, compiled
from rtstack.safety.body import Base, Tool, arm_body
from rtstack.safety.checks import find_arm, find_joint, find_not_finite, take_time
from rtstack.safety.geometry import place_arm
from rtstack.safety.limits import HARDWARE, ForcePhase, PairLimits, SafetyLimits
from rtstack.safety.reasons import NO_INTERVENTION, Cause, Judgement
from rtstack.safety.records import StopProfile, empty_memory, rules
from rtstack.safety.stop import begin_stop, braking_torque, clip

__all__ = ["Base", "Cause", "ForcePhase", "Judgement", "SafetyJudge", "SafetyLimits", "Tool", "judges_of"]

OTHER_ARM = int(Cause.OTHER_ARM)
# A controller that keeps inside its limits may be limited once, by rounding or by chance; one that goes on wanting what
# is impossible has failed. At the robot's rate its torque is 2 Nm astray by then.
LIMITED_TICKS = 3
_PASS, _LIMITED = Judgement.PASS, Judgement.LIMITED
NEVER_NS = 2**62


@compiled
def find_violation(sample, residual, other, rule, memory):
    """Look at everything, place the arm; return the first reason to stop, or 0."""
    late = take_time(sample, other, rule, memory)
    found = find_not_finite(sample, residual, memory)
    if found == 0:
        place_arm(sample["q"], sample["dq"], rule, memory)
        found = find_joint(sample, residual, rule, memory)
        if found == 0:
            found = find_arm(sample, other, rule, memory)
    return found if found != 0 else late


@compiled
def judge(samples, residual, memories, others, all_rules, demand):
    """Judge samples[0].tau_desired, write samples[0].tau_applied, return (verdict, reason).

    demand: 0, or the reason of a stop from outside (COMMANDED, CONTROLLER). others: the other arm's memory, whose
    `silent_ns` is written.
    """
    sample, memory, other, rule = samples[0], memories[0], others[0], all_rules[0]
    found = find_violation(sample, residual, other, rule, memory)
    if memory["stopping"] == 0:
        if found == 0:
            found = demand
        if found == 0 and other["stopping"] != 0:
            found = OTHER_ARM
        if found != 0:
            begin_stop(sample, memory, found)
    if memory["stopping"] == 0:
        reason = clip(sample, rule, memory, sample["tau_desired"])
        memory["limited"] = memory["limited"] + 1 if reason != 0 else 0
        if memory["limited"] < LIMITED_TICKS:
            for i in range(7):
                memory["tau_applied"][i] = sample["tau_applied"][i]
                memory["tau_hold"][i] += rule["hold_share"] * (sample["tau_applied"][i] - memory["tau_hold"][i])
                memory["q_hold"][i] = sample["q"][i]
                memory["dq_hold"][i] = sample["dq"][i]
            return 0 if reason == 0 else 1, reason
        begin_stop(sample, memory, reason)
    braking_torque(sample, rule, memory)
    clip(sample, rule, memory, sample["tau_applied"])
    for i in range(7):
        memory["tau_applied"][i] = sample["tau_applied"][i]
    return 2, memory["reason"]


class SafetyJudge:
    """The judge of one arm. `memory` (1,) of dtype MEMORY is all that it remembers; alone it knows of no other arm."""

    def __init__(
        self,
        limits: SafetyLimits = HARDWARE,
        base: Base | None = None,
        tool: Tool | None = None,
        profile: StopProfile | None = None,
        pair: NDArray[np.void] | None = None,
        side: int = 0,
        other: tuple[Base, Tool] | None = None,
    ) -> None:
        """pair: memories (2,) shared with the other arm's judge; side: which of them is this one's; other: that arm."""
        memories = pair if pair is not None else empty_memory(2)
        self.memory, self._other = memories[side : side + 1], memories[1 - side : 2 - side]
        base, tool = base or Base(), tool or Tool()
        self._rules = rules(limits, profile or StopProfile(), arm_body(base, tool), arm_body(*(other or (base, tool))))
        if pair is None:
            self._rules.flags.writeable = True
            self._rules["skew_max_ns"] = NEVER_NS
            self._rules.flags.writeable = False
        self._no_residual = np.zeros(7)
        self._sample = self._residual = None
        self._judge: Callable[[int], tuple[int, int]] = lambda _demand: (0, 0)
        # what each tick looks at: a number of numpy's own costs more to make, and to compare, than Python's
        self._stopping, self._stale_ns = self.memory["stopping"].data, self.memory["stale_ns"].data
        self._reason, self._phase = self.memory["reason"], self.memory["phase"]
        self._gap_max_ns = int(self._rules["gap_max_ns"][0])
        self.interventions = 0
        self.limited = 0

    @property
    def stopping(self) -> bool:
        """Whether a stop has been latched."""
        return self._stopping[0] != 0

    @property
    def blind(self) -> bool:
        """Whether the state has not changed for longer than allowed: a stop by it pushes an arm that it cannot see."""
        return self._stale_ns[0] > self._gap_max_ns

    @property
    def reason(self) -> Cause:
        """Why the latched stop was made."""
        return Cause(int(self._reason[0]))

    @property
    def joint(self) -> int:
        """Joint (1 to 7) of the last limit or stop, 0 where it was of the whole arm."""
        return int(self.memory["joint"][0]) + 1

    @property
    def explanation(self) -> str:
        """The latched stop in one line: joint, reason, what was found and what was allowed. Not for the tick."""
        reason, record = self.reason, self.memory[0]
        where = f"joint {self.joint}: " if self.joint and reason.unit else ""
        found = f" ({record['value']:.4g} {reason.unit}, allowed {record['bound']:.4g})" if reason.unit else ""
        return f"{where}{reason.text}{found}"

    def judge(
        self, sample: NDArray[np.void], demand: Cause = Cause.NONE, residual: NDArray[np.float64] | None = None
    ) -> Judgement:
        """Write tau_applied of the sample (1,) from its state and tau_desired. Never raises.

        residual: the controller's momentum residual (7,), Nm, to be judged beside the robot's own estimate. A stop that
        was commanded is no intervention; everything else that changed a torque is, once a stop and once a limited tick.
        """
        was_stopping = self._stopping[0]
        look = self._no_residual if residual is None else residual
        if sample is not self._sample or look is not self._residual:
            self.bind(sample, look)
        verdict, reason = self._judge(demand)
        if verdict == 0:
            return _PASS
        if verdict == _LIMITED:
            self.limited += 1
            self.interventions += 1
            return _LIMITED
        if not was_stopping and reason not in NO_INTERVENTION:
            self.interventions += 1
        return Judgement.STOPPING

    def expect(self, phase: ForcePhase) -> None:
        """Judge by the forces of this phase from now on. Never raises."""
        self._phase[0] = phase

    def bind(self, sample: NDArray[np.void], residual: NDArray[np.float64]) -> None:
        """Look up where sample (1,) and residual (7,) are, before a clock runs: a loop shows the same each tick."""
        self._sample, self._residual = sample, residual
        self._judge = bound(judge, sample, residual, self.memory, self._other, self._rules, later=(0,))

    def recover(self, sample: NDArray[np.void], residual: NDArray[np.float64] | None = None) -> Cause:
        """Forget a latched stop and start anew from no torque. Returns NONE, or the reason that persists in the state
        of `sample` (1,): the stop then stays. Of a pair, ask both. Not for the tick; motion needs arming besides."""
        trial = self.memory.copy()
        trial["seen"], self._other["silent_ns"] = 0, 0
        look = self._no_residual if residual is None else residual
        found = find_violation(sample[0], look, self._other.copy()[0], self._rules[0], trial[0])
        if found == 0:
            self.memory[:] = empty_memory(1)
        return Cause(int(found))


def judges_of(
    limits: PairLimits, bases: Sequence[Base], tools: Sequence[Tool], profile: StopProfile | None = None
) -> tuple[SafetyJudge, ...]:
    """Return the judge of each arm. Two watch each other: distance, silence, and that neither goes on alone."""
    if len(limits) == 1:
        return (SafetyJudge(limits[0], bases[0], tools[0], profile),)
    pair = empty_memory(2)
    arms = list(zip(bases, tools, strict=True))
    return tuple(SafetyJudge(limits[k], *arms[k], profile, pair, k, arms[1 - k]) for k in range(2))
