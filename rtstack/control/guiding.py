"""The law of an arm that a person moves by hand: no torque but damping, springs at its limits, and the way back.

Inside its limits an arm is free but for damping, and for a friction that holds it against a payload that is a little
wrong (elastic, then sliding, as Dahl's): an arm that no hand touches stays where it is. Beyond a line (a joint's, or
the box's of the pad), a little inside the judge's, it hangs on a spring whose rest follows the hand to the inside, at
INSIDE_RAD_S or INSIDE_M_S at most, and never goes back out.
"""

import numpy as np

from hal.compilation import bound, compiled, fields
from hal.limits import CONTROL_PERIOD_S
from rtstack.control.controller import ArmLaw, ObservedArm
from rtstack.safety.limits import SafetyLimits
from rtstack.safety.records import StopProfile
from rtstack.samples import Mode, QpStatus

INSIDE_RAD_S = 0.05
INSIDE_M_S = 0.03
# ours: a spring begins this far inside the judge's line
LINE_RAD, LINE_M = 0.01, 0.005
# and where a joint so fast, rad/s, is slow enough for the robot, which allows less near its own limit (hal.limits)
_SPEED_AT_LINE = 0.3
_FREE = (3.0, 3.0, 2.5, 2.5, 1.0, 1.0, 1.0)  # ours, Nms/rad: a push dies out within half a second
# ours, Nm: what it takes to move a joint. A pad that is 0.3 kg heavier than was said turns the shoulder with 2 Nm
_BREAKAWAY = (3.0, 3.0, 2.0, 2.0, 0.6, 0.6, 0.4)
_GRIP_RAD = 0.01  # how far a joint gives before it slides
# where the arm stands beyond a limit: times that (the wrist's is then still below the judge's), and of the pad
_SLOW, _SLOW_NS_M = 3.0, 100.0
_SPRING_N_M, _DAMPER_NS_M = 1000.0, 80.0  # ours: critical for the 1.6 kg that a pad weighs at least
_OPENING = 4.0  # how much faster than it was led back an arm is let go, so that no spring ends at once

LINES = np.dtype(
    [
        # rest of the lower and of the upper springs; joints rad, then the pad's x y z m. Between them the arm is free
        *fields("f8", "low high line_low line_high step stiffness damping", 10),
        # damping where it is free: of the joints, and of the pad
        ("free", "f8", 7),
        ("pad", "f8"),
        # the friction: where each joint's spring is at rest
        *fields("f8", "rest breakaway", 7),
        ("begun", "i8"),
    ]
)


@compiled
def _lead(value, i, lines):
    """Move both springs of a coordinate by at most a step: in with the arm, and out to the lines."""
    low, high, step = lines["line_low"][i], lines["line_high"][i], lines["step"][i]
    if lines["low"][i] < low:  # beyond the lower line: both springs hold, and go in with the hand
        lines["low"][i] = min(low, max(lines["low"][i], min(value, lines["low"][i] + step)))
        lines["high"][i] = lines["low"][i]
    elif lines["high"][i] > high:
        lines["high"][i] = max(high, min(lines["high"][i], max(value, lines["high"][i] - step)))
        lines["low"][i] = lines["high"][i]
    else:
        lines["low"][i] = max(low, lines["low"][i] - _OPENING * step)
        lines["high"][i] = min(high, lines["high"][i] + _OPENING * step)


@compiled
def _begin(value, i, lines):
    low, high = lines["line_low"][i], lines["line_high"][i]
    lines["low"][i], lines["high"][i] = low, high
    if value < low or value > high:
        lines["low"][i] = lines["high"][i] = value


@compiled
def guide(samples, workspaces, limits, all_lines):
    """Write tau_desired (7,), Nm, of a hand-guided arm, at most a step away from the last applied torque."""
    sample, work, lines, limit = samples[0], workspaces[0], all_lines[0], limits[0]
    out = sample["tau_desired"]
    first = lines["begun"] == 0
    lines["begun"] = 1
    for i in range(7):
        q, dq = sample["q"][i], sample["dq"][i]
        if first:
            _begin(q, i, lines)
            lines["rest"][i] = q
        _lead(q, i, lines)
        lines["rest"][i] = min(max(lines["rest"][i], q - _GRIP_RAD), q + _GRIP_RAD)
        out[i] = lines["breakaway"][i] / _GRIP_RAD * (lines["rest"][i] - q) - lines["free"][i] * dq
        away = q - min(max(q, lines["low"][i]), lines["high"][i])
        if away != 0.0:
            out[i] -= lines["stiffness"][i] * away + lines["damping"][i] * dq
    for a in range(3):
        place, velocity = work["position"][a], work["twist"][a]
        if first:
            _begin(place, 7 + a, lines)
        _lead(place, 7 + a, lines)
        away = place - min(max(place, lines["low"][7 + a]), lines["high"][7 + a])
        force = -lines["pad"] * velocity
        if away != 0.0:
            force = -lines["stiffness"][7 + a] * away - lines["damping"][7 + a] * velocity
        for i in range(7):
            out[i] += work["J"][a, i] * force
    for i in range(7):
        last, most = work["tau_previous"][i], limit["tau_max"][i]
        tau = min(max(out[i], -most), most)
        out[i] = min(max(tau, last - limit["tau_step"]), last + limit["tau_step"])


class GuidingLaw(ArmLaw):
    """The ArmLaw of a hand-guided arm. limits: the cell's; outside: whether the arm stands beyond one of them."""

    def __init__(self, arm: ObservedArm, limits: SafetyLimits, outside: bool) -> None:
        """Compile it, before a clock runs."""
        self.lines = np.zeros(1, LINES)
        lines, profile = self.lines[0], StopProfile()
        room = (_SPEED_AT_LINE + limits.arm.velocity_offset) ** 2 / (2.0 * limits.arm.deceleration)
        low = np.maximum(limits.q_lower, limits.arm.q_lower + room) + LINE_RAD
        high = np.minimum(limits.q_upper, limits.arm.q_upper - room) - LINE_RAD
        lines["line_low"] = *low, *np.add(limits.ee_lower, LINE_M)
        lines["line_high"] = *high, *np.subtract(limits.ee_upper, LINE_M)
        lines["step"] = *[INSIDE_RAD_S * CONTROL_PERIOD_S] * 7, *[INSIDE_M_S * CONTROL_PERIOD_S] * 3
        lines["stiffness"] = *profile.stiffness, *[_SPRING_N_M] * 3
        lines["damping"] = *profile.damping, *[_DAMPER_NS_M] * 3
        lines["breakaway"] = _BREAKAWAY
        lines["free"], lines["pad"] = np.multiply(_FREE, _SLOW if outside else 1.0), _SLOW_NS_M if outside else 0.0
        self._arm = arm
        self._guide = bound(guide, arm.sample, arm.workspace, arm.limits, self.lines)
        before = arm.sample.copy(), arm.workspace.copy()
        self._guide()
        arm.sample[:], arm.workspace[:] = before
        lines["begun"] = 0

    def command(self, mode: Mode) -> QpStatus:
        self._guide()
        return QpStatus.NOT_USED
