"""Whether a hand can have moved as its poses say. One place for all devices: the limits, and what is measured.

Trackers lose a hand and find it elsewhere while they report it as tracked: 77.7 mm between two samples of a controller
that lay still (3.9 m/s) [1], 730 mm in one frame [2]. A motion is refused where no pair of samples within WINDOW_S can
be of a hand: for a way x in the time t and the velocity v before it

    |x| <= max(STEP_M_S min(t, STEP_S), SPEED_M_S t) + NOISE_M
    |x - v t| <= ACCELERATION_M_S2 t (t + t_v) / 2 + NOISE_M (1 + t / t_v)

where v is the mean over the time t_v to the sample before. One v of those that the window has may satisfy the second
line: a device that is read as often as it measures now and then gives the same pose twice.

[1] BarisYazici/franka-rs, tools/vr-teleop/docs/design.md. [2] NVIDIA/IsaacTeleop, issue 731.
[3] Flash and Hogan, The Coordination of Arm Movements, J. Neurosci. 1985.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from hal.base.arrays import Array
from rtstack.teleoperation.reach import UNIT_TOLERANCE
from rtstack.teleoperation.stamp import Stamp

STEP_M_S, STEP_S = 2.5, 0.02  # between two samples: the gate of [1]
SPEED_M_S = 1.5  # over a longer time: the operators of [1] were never faster than 0.71 m/s, and pads follow at 0.4 m/s
TURN_RAD_S = 10.0  # those of [1] turned at 5.9 rad/s at most
ACCELERATION_M_S2 = 50.0  # a reach of 0.5 m in 0.3 s with minimum jerk takes 32 m/s2 [3]
NOISE_M, NOISE_RAD = 3e-3, 0.05  # of a pose: tremor is below 1 mm, and what trackers add is of that size
CLOCK_S = 0.01  # a sample's time is no better known: a page is called some ms before or after its picture
LEAST_S = 0.005  # over a shorter time a velocity is noise
WINDOW_S = 0.1  # in which steps add up
PAUSE_S = 0.12  # without a pose: the hand leads from where it is then, as in [1]. A sender's period is shorter
LOST_S = 0.25  # without a pose: the hand is lost, as in [1]
DELAY_S = 0.1  # a command is on its way for no longer (console.teleoperation.gate): times of senders vary by it at most


class HandMotion:
    """The poses of the hands of these sides since they began to lead. Not for two threads at a time."""

    def __init__(self, sides: Sequence[str]) -> None:
        self._sides = sides
        self.paused: str | None = None  # that one of the newest poses came after a pause: its hand leads from there on
        self._now_s = 0.0
        self._last: tuple[str, float, int] | None = None  # the newest command: sender, its time, ms, and arrival, ns
        self._samples: dict[str, deque[tuple[float, Array]]] = {}

    def forget(self) -> None:
        """Forget the poses: nothing leads any more."""
        self._samples.clear()

    def advance(self, stamp: Stamp, came_ns: int) -> None:
        """Take the time of a command: its sender's, or where that stands still, or is another one's, its arrival."""
        sender, made_ms, before_ns = self._last or (stamp.sender, stamp.made_ms, came_ns)
        self._last = stamp.sender, stamp.made_ms, came_ns
        came_s = max(0.0, 1e-9 * (came_ns - before_ns))
        made_s = 1e-3 * (stamp.made_ms - made_ms) if sender == stamp.sender else 0.0
        self._now_s += min(made_s, came_s + DELAY_S) if made_s > 0.0 else came_s

    def problem(self, kind: str, poses: Sequence[Array | None], lost_s: float = LOST_S) -> str | None:
        """Take the newest poses, (7,) each, m and wxyz. Return why they cannot be followed, None where they can.

        kind: "hand": a side without one leads nothing, and may be anywhere later; "sensor": what the sender has made
        the rest of its command from; "pose": where a pad is to be. lost_s: without a pose for longer it is lost.
        """
        found = self.paused = None
        for side, pose in zip(self._sides, poses, strict=True):
            if pose is not None:
                found = found or self._of_one(f"{side} {kind}", pose, lost_s)
            elif kind == "hand":
                self._samples.pop(f"{side} hand", None)
                self._samples.pop(f"{side} sensor", None)
        return found

    def _of_one(self, name: str, pose: Array, lost_s: float) -> str | None:
        length = float(np.linalg.norm(pose[3:]))
        if not np.isfinite(pose).all() or abs(length - 1.0) > UNIT_TOLERANCE:
            return f"the {name} has no pose: finite numbers and a quaternion of length one are needed"
        samples = self._samples.setdefault(name, deque())
        gap_s = self._now_s - samples[-1][0] if samples else 0.0
        if gap_s > lost_s:
            return f"the {name} was not seen for {gap_s:.2f} s"
        if gap_s > PAUSE_S and lost_s < math.inf:
            self.paused = f"the {name} was not seen for {gap_s:.2f} s: it leads from where it is now"
            samples.clear()
        while len(samples) > 1 and samples[0][0] < self._now_s - WINDOW_S:
            samples.popleft()
        samples.append((self._now_s, np.concatenate((pose[:3], pose[3:] / length))))
        return _jump(name, samples)


def _jump(name: str, samples: deque[tuple[float, Array]]) -> str | None:
    """Return how the newest sample is out of reach of the hand that the others are of, None where it is not."""
    (now_s, pose), earlier = samples[-1], list(samples)[:-1]
    for t_s, other in earlier:
        span_s, far = max(now_s - t_s, CLOCK_S), float(np.linalg.norm(pose[:3] - other[:3]))
        turned = 2.0 * math.acos(min(1.0, abs(float(pose[3:] @ other[3:]))))
        if turned > TURN_RAD_S * span_s + NOISE_RAD:
            return f"the {name} turned by {math.degrees(turned):.0f} degrees in {1e3 * span_s:.0f} ms"
        if far > max(STEP_M_S * min(span_s, STEP_S), SPEED_M_S * span_s) + NOISE_M:
            return f"the {name} moved by {1e3 * far:.0f} mm in {1e3 * span_s:.0f} ms"
    last_s, last = earlier[-1] if earlier else samples[-1]
    before = [(last_s - t_s, last[:3] - other[:3]) for t_s, other in earlier if last_s - t_s >= LEAST_S]
    if not before:
        return None
    way, step_s, before_s = pose[:3] - last[:3], now_s - last_s, before[-1][0]
    ahead = min(float(np.linalg.norm(way - gone * (step_s / each_s))) for each_s, gone in before)
    of_hand = ACCELERATION_M_S2 * max(step_s, CLOCK_S) * (max(step_s, CLOCK_S) + before_s) / 2.0
    if ahead > of_hand + NOISE_M * (1.0 + step_s / before_s):
        return f"the {name} set off by {1e3 * float(np.linalg.norm(way)):.0f} mm in {1e3 * step_s:.0f} ms"
    return None
