"""What a report needs beside a trial's result, from the samples of its log: contacts, delay, peaks, steps, swing.

Where the pads touch is geometry: the measured pad (O_T_EE) and the tracked object, not the plant's contacts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.control.completion import CompletionDetector
from rtstack.control.parameters import CompletionParameters, ControlParameters, DetectorParameters
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.safety.limits import HARDWARE, control_limits
from rtstack.samples import Mode, QpStatus
from rtstack.trials.scoring import FORCE_WINDOW_S

STANDING_POSES = 20  # of the tracker before anything moves
SETTLING_S = 0.5
SLIPPED_M = 1e-3  # ten times the tracker's noise
LAST_S = 0.05
SWING_S = 0.15
BEFORE_S, AFTER_S = 0.05, 0.3  # around the impact: where steps are looked for


@dataclass(frozen=True, slots=True)
class Measures:
    """Times in s since the start or in ms, forces N (norms mix N and Nm, as (33) does). None: there was none.

    first_contact_s: of the first pad that reaches the object, second_ of the other one; detection_delay_ms: from the
    first contact to the detection. delay_peak: how much (33) rises meanwhile; delay_peak_velocity_share: the part of
    that rise, along y at the pad that was hit, which is velocity feedback. peak_in_window: of (33), 200 ms around T_r.
    largest_step: of the desired wrenches of both arms from one tick to the next, largest_step_ms when, from T_r;
    largest_step_other: of the arm alone that is not hit first. step_to_interim and step_to_post: where ante-impact mode
    and where interim (or ante-impact) mode ends. posture_peak: of |beta|, rad/s^2, of the arm that is hit first, 200 ms
    around T_r.

    settled_ms: from the first contact to where the object no longer slips on either pad; None where that is not within
    0.5 s (a censored time), or there was no contact. slip_mm: how far the pads have risen beyond the object by then.
    lost_ms: for how long a pad lost the object in the 0.5 s after both had felt it, by the estimated force. swing_m_s:
    peak to peak, along y, of the pad that was hit, in the 150 ms after T_r, swing_other_m_s of the other one.
    contact_completed_s: when the detector of contact_completion, run on the log, finds both pads in lasting contact;
    interim_ms: length of the interim mode. limited_ticks: in which a limit of the QP was active on an arm, and
    rate_limited_ticks: in which the limit of the torque's rate was; both are limits that the paper does not have so.
    placed_x_mm, placed_y_mm, placed_yaw_deg: where the tracker saw the object stand before it was met, from its nominal
    place; None where it was not seen.
    """

    first_contact_s: float | None
    second_contact_s: float | None
    detection_delay_ms: float | None
    delay_peak: float | None
    delay_peak_velocity_share: float | None
    peak_in_window: float | None
    largest_step: float | None
    largest_step_ms: float | None
    step_to_interim: float | None
    step_to_post: float | None
    settled_ms: float | None
    swing_m_s: float | None
    largest_step_other: float | None
    posture_peak: float | None
    slip_mm: float | None
    lost_ms: float | None
    swing_other_m_s: float | None
    limited_ticks: int
    rate_limited_ticks: int
    contact_completed_s: float | None
    interim_ms: float | None
    placed_x_mm: float | None
    placed_y_mm: float | None
    placed_yaw_deg: float | None


@dataclass(frozen=True, slots=True)
class Passage:
    """A trial's samples as the report's figures show them. Arrays over n ticks, (2, n) for (left, right).

    face_y, velocity_y: of the pads in the world, m, m/s; gap: between pad and object, m, negative where pressed; slip:
    how far a pad has risen beyond the object since the start, m, NaN where the object was never seen.
    """

    t_s: Array
    face_y: Array
    slip: Array
    velocity_y: Array
    gap: Array
    force_norm: Array

    def contact(self, arm: int) -> int | None:
        return _first(self.gap[arm] <= 0.0)


def passage(columns: Columns, description: CellDescription, object_name: str) -> Passage:
    t_ns = columns.arm[0]["t_ns"]
    n = len(t_ns)
    thing = _object_poses(columns.object, t_ns)
    half_y = description.objects[object_name].size[1] / 2.0
    face_y, gap, slip = np.zeros((2, n)), np.full((2, n), np.inf), np.full((2, n), np.nan)
    for arm, mounting in enumerate(description.arms):
        frame = base_frame(mounting)
        position = columns.arm[arm]["O_T_EE"][:, :3, 3] @ frame.rotation.T + frame.translation
        face_y[arm] = position[:, 1]
        if thing is None:
            continue
        rotation = frame.rotation @ columns.arm[arm]["O_T_EE"][:, :3, :3]
        centre, axis_y = thing
        slip[arm] = position[:, 2] - position[0, 2] - (centre[:, 2] - centre[0, 2])
        # the corner of a tilted pad that comes nearest: its way along the object's y from the middle of the face
        along = np.einsum("ni,nij->nj", axis_y, rotation[:, :, :2])
        reach = np.abs(along) @ (np.array(description.pads[arm].size[:2]) / 2.0)
        gap[arm] = np.abs(np.einsum("ni,ni->n", axis_y, position - centre)) - half_y - reach
    velocity_y = np.zeros_like(face_y)
    step_s = 1e-9 * (t_ns[2 * SLOPE :] - t_ns[: -2 * SLOPE])
    velocity_y[:, SLOPE:-SLOPE] = (face_y[:, 2 * SLOPE :] - face_y[:, : -2 * SLOPE]) / step_s
    norm = np.linalg.norm(columns.control["wrench_desired"], axis=(0, 2))
    return Passage((t_ns - t_ns[0]) * 1e-9, face_y, slip, velocity_y, gap, norm)


def _object_poses(poses: NDArray[np.void], t_ns: NDArray[np.int64]) -> tuple[Array, Array] | None:
    """Return the object's centre and its y axis, (n, 3) in the world, at each tick. None where it was never seen."""
    if not len(poses):
        return None
    w, x, y, z = poses["orientation_wxyz"].T
    axis_y = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=1)
    at_ticks = []
    for seen in (poses["position"], axis_y):
        seen = np.array(seen)
        seen[:STANDING_POSES] = np.median(seen[:STANDING_POSES], axis=0)  # it stands: the noise of one frame is 0.1 mm
        at_ticks.append(np.stack([np.interp(t_ns, poses["t_ns"], column) for column in seen.T], axis=1))
    return at_ticks[0], at_ticks[1]


def hit_arm(displacement_mm: float) -> int:
    """Return the arm (0 left, 1 right) towards which the object was shifted; the right one for none, as at -30 mm."""
    return 0 if displacement_mm > 0.0 else 1


def measure(
    columns: Columns, description: CellDescription, object_name: str, displacement_mm: float,
    nominal_impact_s: float, detected_impact_s: float | None,
) -> Measures:  # fmt: skip
    """Measure a trial. Of one that ended before its impact, what there is."""
    seen = passage(columns, description, object_name)
    t_s, norm = seen.t_s, seen.force_norm
    contacts = sorted(tick for tick in (seen.contact(0), seen.contact(1)) if tick is not None)
    first = contacts[0] if contacts else None
    mode = columns.control[0]["mode"]
    detected = None if detected_impact_s is None else int(np.searchsorted(t_s, detected_impact_s - 1e-9))
    completed = None
    if detected is not None:
        completed = contact_completed(columns, description, detected, SETTLING_S, CompletionParameters())
        # or the nominal time, where that is what a baseline waits for
        detected = min(detected, int(np.argmax(mode != Mode.ANTE_IMPACT)))
    peak = share = None
    if first is not None and detected is not None and first < detected < len(t_s):
        arm = 0 if seen.contact(0) == first else 1
        top = first + int(np.argmax(norm[first:detected]))  # in the detection's own tick the mode has changed
        peak = float(norm[top] - norm[first])
        share = _velocity_share(columns, seen, arm, first, top)
    wrench = columns.control["wrench_desired"]
    change = np.diff(wrench, axis=1, prepend=wrench[:, :1])
    steps, apart = np.linalg.norm(change, axis=(0, 2)), np.linalg.norm(change, axis=2)
    hit = hit_arm(displacement_mm)
    settled_ms, slip_mm = _settled(seen, first)
    moving = mode != Mode.STOPPING
    impact_s = min(s for s in (nominal_impact_s, detected_impact_s) if s is not None)
    around = (t_s > impact_s - BEFORE_S) & (t_s < nominal_impact_s + AFTER_S) & moving
    window = (np.abs(t_s - nominal_impact_s) <= FORCE_WINDOW_S + 1e-9) & moving
    largest = int(np.argmax(np.where(around, steps, 0.0))) if around.any() else None
    placed = _placed(columns.object)
    swing = (t_s >= nominal_impact_s) & (t_s < nominal_impact_s + SWING_S) & moving
    return Measures(
        first_contact_s=_at(t_s, first),
        second_contact_s=_at(t_s, contacts[1]) if len(contacts) > 1 else None,
        detection_delay_ms=None if first is None or detected is None else float(1e3 * (detected_impact_s - t_s[first])),
        delay_peak=peak,
        delay_peak_velocity_share=share,
        peak_in_window=float(norm[window].max()) if window.any() else None,
        largest_step=_at(steps, largest),
        largest_step_ms=None if largest is None else float(1e3 * (t_s[largest] - nominal_impact_s)),
        step_to_interim=_at(steps, _first(mode == Mode.INTERIM)),
        step_to_post=_at(steps, _first(mode == Mode.POST_IMPACT)),
        settled_ms=settled_ms,
        swing_m_s=float(np.ptp(seen.velocity_y[hit, swing])) if swing.sum() > 1 else None,
        largest_step_other=float(apart[1 - hit][around].max()) if around.any() else None,
        posture_peak=float(np.abs(columns.control[hit]["beta"][window]).max()) if window.any() else None,
        slip_mm=slip_mm,
        lost_ms=_lost_ms(columns, seen, first),
        swing_other_m_s=float(np.ptp(seen.velocity_y[1 - hit, swing])) if swing.sum() > 1 else None,
        limited_ticks=int(((columns.control["qp_status"] != QpStatus.UNCONSTRAINED).any(axis=0) & moving).sum()),
        rate_limited_ticks=_rate_limited(columns, moving),
        contact_completed_s=_at(t_s, completed),
        interim_ms=_interim_ms(t_s, mode),
        placed_x_mm=placed[0],
        placed_y_mm=placed[1],
        placed_yaw_deg=placed[2],
    )


def _placed(poses: NDArray[np.void]) -> tuple[float | None, float | None, float | None]:
    """Return where the object stands before anything moves: mm along x and y, degrees about z within a quarter turn."""
    if not len(poses):
        return None, None, None
    x, y = 1e3 * np.median(poses["position"][:STANDING_POSES, :2], axis=0)
    w, _, _, z = np.median(poses["orientation_wxyz"][:STANDING_POSES], axis=0)
    yaw_deg = (np.degrees(2.0 * np.arctan2(z, w)) + 90.0) % 180.0 - 90.0
    return float(x), float(y), float(yaw_deg)


def _at(values: Array, tick: int | None) -> float | None:
    return None if tick is None else float(values[tick])


def _first(condition: NDArray[np.bool_]) -> int | None:
    ticks = np.flatnonzero(condition)
    return int(ticks[0]) if len(ticks) else None


def _interim_ms(t_s: Array, mode: NDArray[np.int64]) -> float | None:
    """Length of the interim mode; None where there was none, or where the trial ended in it."""
    begin, end = _first(mode == Mode.INTERIM), _first(mode == Mode.POST_IMPACT)
    return None if begin is None or end is None else float(1e3 * (t_s[end] - t_s[begin]))


def _settled(seen: Passage, first: int | None) -> tuple[float | None, float | None]:
    """Return when the object stopped to slip on the pads, ms from the first contact, and how far it had slipped, mm.

    It has stopped where the slip of either pad stays within SLIPPED_M of what it is at the end of SETTLING_S. The time
    is None where the slip still changes in the last LAST_S of it (censored), both are None without contact or object.
    """
    if first is None or np.isnan(seen.slip[0, 0]):
        return None, None
    since_s = seen.t_s - seen.t_s[first]
    soon = np.flatnonzero((since_s >= 0.0) & (since_s <= SETTLING_S))
    if since_s[-1] < SETTLING_S:
        return None, None
    slip = seen.slip[:, soon]
    moving = np.flatnonzero((np.abs(slip - slip[:, -1:]) > SLIPPED_M).any(axis=0))
    last_s = float(since_s[soon[moving[-1]]]) if len(moving) else 0.0
    slip_mm = 1e3 * float((slip[:, -1] - slip[:, 0]).max())
    return (1e3 * last_s if last_s < SETTLING_S - LAST_S else None), slip_mm


def _lost_ms(columns: Columns, seen: Passage, first: int | None) -> float | None:
    """Return for how long a pad lost the object, ms, in SETTLING_S after both had felt it: the longer of both pads.

    By the robot's estimate of the force, less what it was shortly before the first contact; the bounds that tell
    contact from none are Appendix B's.
    """
    if first is None:
        return None
    bounds, before = DetectorParameters(), max(0, first - round(1e3 * BEFORE_S))
    forces = columns.arm["O_F_ext_hat_K"][:, :, :3]
    norm = np.linalg.norm(forces - forces[:, before : before + 1], axis=2)
    felt = [_first(each > bounds.force_high_n) for each in norm[:, first:]]
    if felt[0] is None or felt[1] is None:
        return None
    since_s = seen.t_s - seen.t_s[first + max(felt[0], felt[1])]
    soon = (since_s >= 0.0) & (since_s <= SETTLING_S)
    lost = (norm[:, soon] < bounds.force_low_n).mean(axis=1).max()
    return 1e3 * float(lost * np.ptp(seen.t_s[soon]))


def _rate_limited(columns: Columns, moving: NDArray[np.bool_]) -> int:
    """Count the ticks in which a commanded torque changed by as much as the controller lets it."""
    steps = np.abs(np.diff(columns.arm["tau_desired"], axis=1))
    at_limit = (steps >= control_limits(HARDWARE)[0]["tau_step"] - 1e-9).any(axis=(0, 2))
    return int((at_limit & moving[1:]).sum())


def _velocity_share(columns: Columns, seen: Passage, arm: int, first: int, top: int) -> float | None:
    """Part of the change of the desired force along y, from tick `first` to `top`, that is velocity feedback.

    The force is feedforward + stiffness x position error + damping x velocity error (22); the first two are logged.
    """
    control = columns.control[arm]
    force = control["wrench_desired"][:, 1]
    position = ControlParameters().stiffness[1] * (control["pose_ref"][:, 1] - seen.face_y[arm])
    velocity = force - control["wrench_ff"][:, 1] - position
    change = force[top] - force[first]
    return float((velocity[top] - velocity[first]) / change) if abs(change) > 1e-6 else None


SLOPE = 2  # ticks on each side over which a velocity is taken: 2 mm/s of the encoders' noise are left


def contact_completed(
    columns: Columns, description: CellDescription, first: int, patience_s: float, parameters: CompletionParameters
) -> int | None:
    """Return the tick at which contact was complete, looked for from the tick `first` (the detected impact) on.

    Velocities are differences of the measured O_T_EE: the log alone is enough, and the detector's own Jacobian is
    within the encoders' noise of them. None where there was no full contact within patience_s.
    """
    t_s = (columns.arm[0]["t_ns"] - columns.arm[0]["t_ns"][0]) * 1e-9
    last = int(np.searchsorted(t_s, t_s[min(first, len(t_s) - 1)] + patience_s))
    span = slice(first - SLOPE, last + SLOPE)
    if first < SLOPE or last + SLOPE > len(t_s):
        return None
    duration_s = (t_s[span][2 * SLOPE :] - t_s[span][: -2 * SLOPE])[:, None]
    force, rotation, velocity = [], [], []
    for arm, mounting in enumerate(description.arms):
        world = base_frame(mounting).rotation
        pose = columns.arm[arm]["O_T_EE"][span]
        place = pose[:, :3, 3] @ world.T
        velocity.append((place[2 * SLOPE :] - place[: -2 * SLOPE]) / duration_s)
        rotation.append(world @ pose[SLOPE:-SLOPE, :3, :3])
        force.append(-columns.arm[arm]["O_F_ext_hat_K"][first:last, :3] @ world.T)  # ON the end effector
    detectors = (CompletionDetector(parameters), CompletionDetector(parameters))
    for k in range(last - first):
        held = [
            detector.update(t_s[first + k], force[a][k], rotation[a][k], velocity[a][k], velocity[1 - a][k])
            for a, detector in enumerate(detectors)
        ]
        if all(held):
            return first + k
    return None
