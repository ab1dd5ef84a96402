"""The safety judge at the end of the tick: it sees a state and a desired torque, and answers pass, limit or stop.

A stop latches. It is a braking profile: each joint's velocity goes to zero at a fixed deceleration around a torque that
holds what was held, and the arm then stays where it came to rest.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hal.limits import CONTROL_PERIOD_S, FR3, ArmLimits

Array = NDArray[np.floating]


class Verdict(IntEnum):
    """What became of the desired torque."""

    PASS = 0
    LIMITED = 1
    STOPPING = 2


class Reason(IntEnum):
    """Why the judge limited or stopped."""

    NONE = 0
    COMMANDED = 1  # somebody asked for the stop; not an intervention
    TORQUE = 2
    TORQUE_RATE = 3
    NOT_FINITE = 4
    JOINT_POSITION = 5
    JOINT_VELOCITY = 6
    MEASURED_TORQUE = 7
    CONTROLLER = 8  # the controller has no torque: its QP was not solved


@dataclass(frozen=True, slots=True)
class JudgeParameters:
    """Where the judge draws its lines. Fractions are of the hardware's limits."""

    limits: ArmLimits = FR3
    # the robot's own reflex trips at the limit: stay a little inside
    velocity_fraction: float = 0.98
    position_margin_rad: float = 0.005
    # tau_J swings above the command in the joint oscillation after an impact; the sensor's range is the limit
    measured_torque_fraction: float = 1.0
    # braking: the deceleration of the position-dependent velocity limits is at least this (FR3: 10 rad/s^2 anyhow)
    braking_rad_s2: float = 10.0
    # the hold after a stop: stiff enough to stay, damped critically with the smallest inertia that a joint can have
    # (wrist: B_theta 0.067 and a link of some 0.02 kg m^2), so that it does not ring with the joints' elasticity
    hold_stiffness: tuple[float, ...] = (600.0, 600.0, 600.0, 600.0, 100.0, 80.0, 40.0)  # Nm/rad
    hold_damping: tuple[float, ...] = (50.0, 50.0, 50.0, 50.0, 6.0, 5.5, 4.0)  # Nms/rad
    # the torque that is held through a stop is the mean of about this long
    hold_average_s: float = 0.02


# everything the compiled part needs of the past, one record an arm
MEMORY = np.dtype(
    [
        ("tau_applied", "f8", 7),
        ("tau_hold", "f8", 7),
        ("q_hold", "f8", 7),
        ("dq_hold", "f8", 7),
        ("stopping", "i8"),
        ("reason", "i8"),
        ("joint", "i8"),
        ("started", "i8"),
    ]
)


@njit(cache=True)
def _violation(sample, table, memory):
    """Return the first reason to stop that the state and the desired torque give, and note the joint."""
    for i in range(7):
        memory.joint = i
        finite = (
            np.isfinite(sample.q[i])
            and np.isfinite(sample.dq[i])
            and np.isfinite(sample.tau_J[i])
            and np.isfinite(sample.tau_desired[i])
        )
        if not finite:
            return 4
        room_up = table[1, i] - sample.q[i]
        room_down = sample.q[i] - table[0, i]
        if room_up < 0.0 or room_down < 0.0:
            return 5
        up = min(table[2, i], max(0.0, np.sqrt(2.0 * table[4, i] * room_up) - table[3, i]))
        down = min(table[2, i], max(0.0, np.sqrt(2.0 * table[4, i] * room_down) - table[3, i]))
        if sample.dq[i] > up or sample.dq[i] < -down:
            return 6
        if abs(sample.tau_J[i]) > table[6, i]:
            return 7
    return 0


@njit(cache=True)
def _begin_stop(sample, memory, reason):
    memory.stopping = 1
    memory.reason = reason
    for i in range(7):
        memory.q_hold[i] = sample.q[i] if np.isfinite(sample.q[i]) else memory.q_hold[i]
        memory.dq_hold[i] = sample.dq[i] if np.isfinite(sample.dq[i]) else 0.0


@njit(cache=True)
def _braking_torque(sample, memory, gains, braking, dt):
    """Write the torque of the braking profile to tau_applied; a value that is not finite counts as no error."""
    for i in range(7):
        slower = max(0.0, abs(memory.dq_hold[i]) - braking * dt)
        memory.dq_hold[i] = slower if memory.dq_hold[i] > 0.0 else -slower
        memory.q_hold[i] += memory.dq_hold[i] * dt
        position = memory.q_hold[i] - sample.q[i]
        velocity = memory.dq_hold[i] - sample.dq[i]
        tau = memory.tau_hold[i]
        if np.isfinite(position):
            tau += gains[0, i] * position
        if np.isfinite(velocity):
            tau += gains[1, i] * velocity
        sample.tau_applied[i] = tau


@njit(cache=True)
def _clip(sample, memory, table, tau_step, wanted):
    """Bring `wanted` inside torque and torque rate, write it to tau_applied; return the reason for a change."""
    reason = 0
    for i in range(7):
        tau = wanted[i]
        if tau > table[5, i] or tau < -table[5, i]:
            tau = min(max(tau, -table[5, i]), table[5, i])
            reason = 2
            memory.joint = i
        last = memory.tau_applied[i]
        if tau > last + tau_step or tau < last - tau_step:
            tau = min(max(tau, last - tau_step), last + tau_step)
            if reason == 0:
                reason = 3
                memory.joint = i
        sample.tau_applied[i] = tau
    return reason


@njit(cache=True)
def judge(samples, memories, table, gains, braking, tau_step, hold_share, dt, demand):
    """Judge samples[0].tau_desired, write samples[0].tau_applied, return (verdict, reason).

    table rows: q_lower, q_upper, dq_max, velocity_offset, deceleration, tau_max, tau_J_max. demand: 0, or the reason
    for
    which somebody else wants the stop (COMMANDED, CONTROLLER). gains (2, 7): stiffness and damping of the hold.
    """
    sample = samples[0]
    memory = memories[0]
    if memory.stopping == 0:
        found = _violation(sample, table, memory)
        if found == 0:
            found = demand
        if found != 0:
            _begin_stop(sample, memory, found)
    if memory.stopping != 0:
        _braking_torque(sample, memory, gains, braking, dt)
        _clip(sample, memory, table, tau_step, sample.tau_applied)
        verdict = 2
        reason = memory.reason
    else:
        reason = _clip(sample, memory, table, tau_step, sample.tau_desired)
        verdict = 0 if reason == 0 else 1
    for i in range(7):
        memory.tau_applied[i] = sample.tau_applied[i]
        if memory.stopping == 0:
            memory.tau_hold[i] += hold_share * (sample.tau_applied[i] - memory.tau_hold[i])
    return verdict, reason


class SafetyJudge:
    """The judge of one arm. `memory` (1,) of dtype MEMORY is all that it remembers."""

    def __init__(self, parameters: JudgeParameters | None = None) -> None:
        p = parameters or JudgeParameters()
        limits = p.limits
        self.memory = np.zeros(1, MEMORY)
        self._stopping, self._reason = self.memory["stopping"], self.memory["reason"]
        self.interventions = 0
        self.limited = 0
        self._table = np.array(
            [
                limits.q_lower + p.position_margin_rad,
                limits.q_upper - p.position_margin_rad,
                limits.dq_max * p.velocity_fraction,
                limits.velocity_offset,
                limits.deceleration,
                limits.tau_max,
                limits.tau_max * p.measured_torque_fraction,
            ]
        )
        self._gains = np.array([p.hold_stiffness, p.hold_damping])
        self._braking = p.braking_rad_s2
        # the rate limit of the robot is a strict one, and the wire rounds to single precision
        self._tau_step = limits.tau_rate_max * CONTROL_PERIOD_S * (1.0 - 1e-4)
        self._hold_share = CONTROL_PERIOD_S / p.hold_average_s

    @property
    def stopping(self) -> bool:
        """Whether a stop has been latched."""
        return self._stopping[0] != 0

    @property
    def reason(self) -> Reason:
        """Why the latched stop was made."""
        return Reason(int(self._reason[0]))

    @property
    def joint(self) -> int:
        """Joint (1 to 7) of the last limit or stop."""
        return int(self.memory["joint"][0]) + 1

    def judge(self, sample: NDArray[np.void], demand: Reason = Reason.NONE) -> Verdict:
        """Write tau_applied of the sample (1,) from its state and tau_desired. Never raises.

        A stop that was commanded is no intervention; everything else that changed a torque is, once a stop and once a
        limited tick.
        """
        was_stopping = self.stopping
        verdict, reason = judge(
            sample, self.memory, self._table, self._gains, self._braking, self._tau_step, self._hold_share,
            CONTROL_PERIOD_S, int(demand),
        )  # fmt: skip
        if verdict == 0:
            return Verdict.PASS
        if verdict == Verdict.LIMITED:
            self.limited += 1
            self.interventions += 1
            return Verdict.LIMITED
        if not was_stopping and reason != Reason.COMMANDED:
            self.interventions += 1
        return Verdict.STOPPING
