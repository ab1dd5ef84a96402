"""What a recording gives: its impact, what was good and bad about it, and the references made of it, as in Figure 5."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hal.base.arrays import Array
from rtstack.model.cell_description import CellDescription
from rtstack.references.acceptance import Acceptance
from rtstack.references.recording import Recording, ReferenceError, recording_of, reference_log
from rtstack.references.spreading import ExtendedReference, extend
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.object import check_two_arms

AROUND_S = 0.4  # of the impact: what is drawn closely
_POINTS = 800  # of the whole recording, thinned out
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
    jerk = max(_jerk(arm[:impact], period_s) for arm in points["twist"][:, :, :3])
    even = Remark(f"jerk of the approach: {jerk:.0f} m/s^3", jerk <= LARGEST_JERK_M_S3, "approach in one even movement")
    if len(points) < 2:
        return _speed(speed), even
    between = points["position"][1, impact] - points["position"][0, impact]
    towards = np.array([between, -between]) / np.linalg.norm(between)
    angle = np.arccos(np.clip((velocity * towards).sum(axis=1) / np.maximum(speed, 1e-9), -1.0, 1.0))
    remarks = [
        _speed(speed),
        Remark(
            f"angle to the line between the pads: {np.degrees(angle[0]):.0f} and {np.degrees(angle[1]):.0f} deg",
            bool(angle.max() <= WIDEST_RAD), "close both hands towards each other",
        ),
        even,
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
    text = f"speed at the impact: {' and '.join(f'{each:.2f}' for each in speed)} m/s"
    if speed.min() < SLOWEST_M_S:
        return Remark(text, False, "hit faster: the impact is hardly one")
    return Remark(text, bool(np.ptp(speed) <= UNEQUAL_M_S), "let both hands be equally fast")


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


@dataclass(frozen=True, slots=True)
class Curve:
    """One quantity of one arm, along the world's y: recorded, and extended before and after the impact."""

    recorded: list[float]
    ante: list[float]
    post: list[float]


@dataclass(frozen=True, slots=True)
class Extraction:
    """t_s: times of the curves around the impact; velocity m/s and force N of each arm, by side; whole_*: of all of it.
    problem: why no reference can be made; the curves are empty then. detected_impact_s: None where none was found.
    Times are s since the recording's start; begin_s, end_s: what is used of it, and duration_s: how long that is.
    remarks: what is good and bad about it as a reference."""

    duration_s: float
    object: str
    detected_impact_s: float | None
    nominal_impact_s: float | None
    exclusion_s: float
    release_s: float | None
    problem: str | None
    t_s: list[float]
    velocity: dict[str, Curve]
    force: dict[str, Curve]
    begin_s: float
    end_s: float
    whole_t_s: list[float]
    whole_velocity: dict[str, list[float]]
    whole_force: dict[str, list[float]]
    remarks: list[Remark]


def extract(
    path: Path, description: CellDescription, acceptance: Acceptance, progress: Callable[[float], None] | None = None
) -> Extraction:
    """Make the references of a recording, with what was said about it. ReferenceError: it is none at all. TrialError:
    the cell has one arm. progress: called with the share that is done."""
    check_two_arms(description, "a reference")
    parameters = cell_parameters(description)
    control, sides = parameters.control, description.sides
    arms = arm_controllers(description, parameters)
    log = reference_log(path)
    # shown whatever was decided about it
    recording = recording_of(log, arms, parameters.detector, control.period_s, acceptance, True, progress, sides)
    problem = recording.problem
    reference: ExtendedReference | None = None
    if problem is None:
        try:
            reference = extend(recording, control.exclusion_s)
        except ReferenceError as error:
            problem = str(error)
    n, period_s = recording.points.shape[1], recording.period_s
    begin_s = recording.begin_s
    t_s = begin_s + np.arange(n) * period_s
    whole = recording.points if recording.whole is None else recording.whole
    step = max(1, whole.shape[1] // _POINTS)
    near = slice(0, 0)
    if reference is not None:
        around = round(AROUND_S / period_s)
        near = slice(max(0, recording.impact - around), recording.impact + around)
    curves: dict[str, dict[str, Curve]] = {"twist": {}, "wrench_ff": {}}
    for name, of in curves.items():
        for arm, side in enumerate(sides):
            parts = (recording.points, *((reference.ante, reference.post) if reference is not None else ()))
            drawn = [part[arm][name][near, 1].tolist() for part in parts]
            of[side] = Curve(*drawn) if len(drawn) == 3 else Curve([], [], [])
    return Extraction(
        duration_s=n * period_s,
        object=recording.object,
        detected_impact_s=None if recording.detected is None else begin_s + recording.detected * period_s,
        nominal_impact_s=begin_s + recording.impact_s if recording.impact < n else None,
        exclusion_s=control.exclusion_s,
        release_s=begin_s + recording.release * period_s if recording.impact < n else None,
        problem=problem,
        t_s=t_s[near].tolist(),
        velocity=curves["twist"],
        force=curves["wrench_ff"],
        begin_s=begin_s,
        end_s=begin_s + n * period_s,
        whole_t_s=(np.arange(whole.shape[1])[::step] * period_s).tolist(),
        whole_velocity={side: whole[arm]["twist"][::step, 1].tolist() for arm, side in enumerate(sides)},
        whole_force={side: whole[arm]["wrench_ff"][::step, 1].tolist() for arm, side in enumerate(sides)},
        remarks=list(remarks_on(recording, control.exclusion_s)),
    )
