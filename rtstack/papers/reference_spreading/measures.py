"""What a report needs beside a trial's result, from the samples of the trial: contacts, delay, peaks, steps, swing.

Everything here is seen in the log alone. Where the pads touch is geometry: the measured pad (O_T_EE) and the tracked
object; the plant's own contacts are not used.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.arrays import Array
from rtstack.control.parameters import CompletionParameters, ControlParameters
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.papers.reference_spreading.completion import SLOPE, contact_completed
from rtstack.samples import Mode
from rtstack.trials.scoring import FORCE_WINDOW_S

STANDING_POSES = 20  # of the tracker before anything moves
APART_M = 5e-4  # the silicone gives by more than that under any force that holds
SETTLING_S = 0.5
SWING_S = 0.15
BEFORE_S, AFTER_S = 0.05, 0.3  # around the impact: where steps are looked for


@dataclass(frozen=True, slots=True)
class Measures:
    """Times in s since the start or in ms, forces N (norms mix N and Nm, as (33) does). None: there was none.

    first_contact_s: of the first pad that reaches the object, second_ of the other one; detection_delay_ms: from the
    first contact to the detection. delay_peak: how much (33) rises meanwhile; delay_peak_velocity_share: the part of
    that rise, along y at the pad that was hit, which is velocity feedback. peak_in_window: of (33), 200 ms around T_r.
    largest_step: of the desired wrenches of both arms from one tick to the next, largest_step_ms when, from T_r;
    step_to_interim and step_to_post: where ante-impact mode and where interim (or ante-impact) mode ends.
    settled_ms: from the first contact to where both pads stay on the object. swing_m_s: peak to peak, along y, of the
    pad that was hit, in the 150 ms after T_r. contact_completed_s: when the detector of
    contact_completion, run on the log, finds both pads in lasting contact; interim_ms: length of the interim mode.
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
    contact_completed_s: float | None
    interim_ms: float | None


@dataclass(frozen=True, slots=True)
class Passage:
    """A trial's samples as the report's figures show them. Arrays over n ticks, (2, n) for (left, right).

    face_y, velocity_y: of the pads in the world, m, m/s; gap: between pad and object, m, negative where pressed.
    """

    t_s: Array
    face_y: Array
    velocity_y: Array
    gap: Array
    force_norm: Array

    def contact(self, arm: int) -> int | None:
        """Return the first tick at which a pad touches the object."""
        touching = np.flatnonzero(self.gap[arm] <= 0.0)
        return int(touching[0]) if len(touching) else None


def passage(columns: Columns, description: CellDescription, object_name: str) -> Passage:
    """Look at a trial's samples."""
    t_ns = columns.arm[0]["t_ns"]
    n = len(t_ns)
    thing = _object_poses(columns.object, t_ns)
    half_y = description.objects[object_name].size[1] / 2.0
    face_y, gap = np.zeros((2, n)), np.full((2, n), np.inf)
    for arm, mounting in enumerate((description.left, description.right)):
        frame = base_frame(mounting)
        position = columns.arm[arm]["O_T_EE"][:, :3, 3] @ frame.rotation.T + frame.translation
        face_y[arm] = position[:, 1]
        if thing is None:
            continue
        rotation = frame.rotation @ columns.arm[arm]["O_T_EE"][:, :3, :3]
        centre, axis_y = thing
        # the corner of a tilted pad that comes nearest: its way along the object's y from the middle of the face
        along = np.einsum("ni,nij->nj", axis_y, rotation[:, :, :2])
        reach = np.abs(along) @ (np.array(description.pads[arm].size[:2]) / 2.0)
        gap[arm] = np.abs(np.einsum("ni,ni->n", axis_y, position - centre)) - half_y - reach
    velocity_y = np.zeros_like(face_y)
    step_s = 1e-9 * (t_ns[2 * SLOPE :] - t_ns[: -2 * SLOPE])
    velocity_y[:, SLOPE:-SLOPE] = (face_y[:, 2 * SLOPE :] - face_y[:, : -2 * SLOPE]) / step_s
    norm = np.linalg.norm(columns.control["wrench_desired"], axis=(0, 2))
    return Passage((t_ns - t_ns[0]) * 1e-9, face_y, velocity_y, gap, norm)


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
    if detected is not None:  # or the nominal time, where that is what a baseline waits for
        detected = min(detected, int(np.argmax(mode != Mode.ANTE_IMPACT)))
    peak = share = None
    if first is not None and detected is not None and first < detected < len(t_s):
        arm = 0 if seen.contact(0) == first else 1
        top = first + int(np.argmax(norm[first:detected]))  # in the detection's own tick the mode has changed
        peak = float(norm[top] - norm[first])
        share = _velocity_share(columns, seen, arm, first, top)
    wrench = columns.control["wrench_desired"]
    steps = np.linalg.norm(np.diff(wrench, axis=1, prepend=wrench[:, :1]), axis=(0, 2))
    moving = mode != Mode.STOPPING
    impact_s = min(s for s in (nominal_impact_s, detected_impact_s) if s is not None)
    around = (t_s > impact_s - BEFORE_S) & (t_s < nominal_impact_s + AFTER_S) & moving
    window = (np.abs(t_s - nominal_impact_s) <= FORCE_WINDOW_S + 1e-9) & moving
    largest = int(np.argmax(np.where(around, steps, 0.0))) if around.any() else None
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
        settled_ms=_settled_ms(seen, first),
        swing_m_s=float(np.ptp(seen.velocity_y[hit_arm(displacement_mm), swing])) if swing.sum() > 1 else None,
        contact_completed_s=_at(t_s, completed),
        interim_ms=_interim_ms(t_s, mode),
    )


def _at(values: Array, tick: int | None) -> float | None:
    return None if tick is None else float(values[tick])


def _first(condition: NDArray[np.bool_]) -> int | None:
    ticks = np.flatnonzero(condition)
    return int(ticks[0]) if len(ticks) else None


def _interim_ms(t_s: Array, mode: NDArray[np.int64]) -> float | None:
    """Length of the interim mode; None where there was none, or where the trial ended in it."""
    begin, end = _first(mode == Mode.INTERIM), _first(mode == Mode.POST_IMPACT)
    return None if begin is None or end is None else float(1e3 * (t_s[end] - t_s[begin]))


def _settled_ms(seen: Passage, first: int | None) -> float | None:
    """Time from the first contact until both pads are on the object for good, None where they are not in 0.5 s."""
    if first is None:
        return None
    soon = (seen.t_s >= seen.t_s[first]) & (seen.t_s <= seen.t_s[first] + SETTLING_S)
    apart = np.flatnonzero((seen.gap > APART_M).any(axis=0) & soon)
    after_ms = 1e3 * (float(seen.t_s[apart[-1]]) - float(seen.t_s[first])) if len(apart) else 0.0
    return after_ms if after_ms < 1e3 * SETTLING_S - 1.5 else None


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
