"""What a demonstration is worth as a reference: what was good and bad about its impact, to demonstrate better."""

from dataclasses import dataclass

import numpy as np

from hal.arrays import Array
from rtstack.references.recording import Recording

_BEFORE_S = 0.02  # the detection is some ms behind the contact: from twice as long before it, for as long
_APPROACH_S = 0.5
_SMOOTHING_S = 0.02  # of the measured velocity, whose noise a derivative would be made of
# the scripted demonstrations, whose trials succeed, hit at 0.35 m/s inwards and 0.15 upwards, which is 23 deg
SLOWEST_M_S, UNEQUAL_M_S = 0.08, 0.1
WIDEST_RAD = np.radians(35.0)  # from the line between both pads: further off a pad slides along the object
LARGEST_JERK_M_S3 = 40.0  # rms of the approach; a minimum-jerk reach of 0.3 m in 1.5 s has 3, a hand that jerks 100


@dataclass(frozen=True, slots=True)
class Remark:
    """One thing about a demonstration: what it is, whether it is good for a reference, and what to do else."""

    text: str
    good: bool
    advice: str = ""


def remarks_on(recording: Recording, exclusion_s: float) -> tuple[Remark, ...]:
    """Return what is good and bad about a recording's impact; nothing where it has none."""
    points, period_s, impact = recording.points, recording.period_s, recording.impact
    ticks = round(_BEFORE_S / period_s)
    if impact >= points.shape[1] or impact <= 2 * ticks:
        return ()
    before = slice(impact - 2 * ticks, impact - ticks)
    velocity = points["twist"][:, before, :3].mean(axis=1)
    speed = np.linalg.norm(velocity, axis=1)
    between = points["position"][1, impact] - points["position"][0, impact]
    towards = np.array([between, -between]) / np.linalg.norm(between)
    angle = np.arccos(np.clip((velocity * towards).sum(axis=1) / np.maximum(speed, 1e-9), -1.0, 1.0))
    jerk = max(_jerk(arm[:impact], period_s) for arm in points["twist"][:, :, :3])
    remarks = [
        _speed(speed),
        Remark(
            f"angle to the line between the pads: {np.degrees(angle[0]):.0f} and {np.degrees(angle[1]):.0f} deg",
            bool(angle.max() <= WIDEST_RAD), "close both hands towards each other",
        ),
        Remark(f"jerk of the approach: {jerk:.0f} m/s^3", jerk <= LARGEST_JERK_M_S3, "approach in one even movement"),
    ]  # fmt: skip
    left, right = recording.hits
    if left is None or right is None:
        which = "left" if left is None else "right"
        remarks.append(Remark(f"the {which} pad has not hit", False, "hit with both pads"))
    elif left == right:
        remarks.append(Remark("both pads hit together", True))
    else:
        apart_s, first = abs(left - right) * period_s, "left" if left < right else "right"
        text = f"the {first} pad hit {1e3 * apart_s:.0f} ms before the other one"
        late = "right" if first == "left" else "left"
        remarks.append(Remark(text, apart_s <= exclusion_s, f"begin with the {late} hand earlier"))
    return tuple(remarks)


def _speed(speed: Array) -> Remark:
    text = f"speed at the impact: {speed[0]:.2f} and {speed[1]:.2f} m/s"
    if speed.min() < SLOWEST_M_S:
        return Remark(text, False, "hit faster: the impact is hardly one")
    return Remark(text, bool(abs(speed[0] - speed[1]) <= UNEQUAL_M_S), "let both hands be equally fast")


def _jerk(velocity: Array, period_s: float) -> float:
    """Return the rms jerk of the last part of an approach (n, 3), m/s^3."""
    part = velocity[-round((_APPROACH_S + _BEFORE_S) / period_s) : -round(_BEFORE_S / period_s)]
    half = round(_SMOOTHING_S / period_s)
    if len(part) < 4 * half:
        return 0.0
    window = np.bartlett(2 * half + 1) / np.bartlett(2 * half + 1).sum()
    smooth = np.array([np.convolve(axis, window, "valid") for axis in part.T])
    second = np.diff(smooth[:, :: max(1, half // 4)], 2, axis=1) / (max(1, half // 4) * period_s) ** 2
    return float(np.sqrt((second**2).sum(axis=0).mean()))
