"""A recording is the log of a teleoperated trial; from it come the signals that the references are made of.

Whether a recording's joints mean the places that the cell's file says: bases and pads by the file that is attached
to it, beside those of the present one, and beside what both pads held.
"""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.base.configuration import ConfigurationError, from_document
from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.expected import ExpectedImpact
from rtstack.references.acceptance import Acceptance, AcceptanceError, AcceptanceState, load_acceptance
from rtstack.references.motion import Motion
from rtstack.samples import SIDES, Mode

LIFTED_S = 0.6  # after the impact the object hangs in the air
CARRIED_SHARE = 0.35  # of its weight: what carrying adds or takes away at most
EARLIER_S = 0.1  # a trial meets the table earlier, where it has grabbed the object lower
NEAR_TABLE_M = 0.01  # a planned object that is not higher may stand on the table: arms sag, and it slips in the pads
SMOOTHING_S = 0.02  # on each side: what oscillates in the demonstration's velocities is no reference


def demonstrated_impact(
    q: Array, dq: Array, force: Array, impact: int, release: int, excluded: int, period_s: float
) -> ExpectedImpact:
    """Return the impact of a demonstration: q, dq (2, n, 7), force (2, n, 3) ON the pads, N, along the world's axes.

    impact, release: indices of T_r and of the release; excluded: Delta T_r in ticks, around T_r. The joint velocities
    are those of the post-impact reference of (14), extended like (16) to the time before T_p.
    """
    half = round(SMOOTHING_S / period_s)
    smooth = np.stack([_smooth(values, half) for values in dq])
    post = smooth.copy()
    post[:, : impact + excluded] = smooth[:, impact + excluded, None]
    # before the impact a pad feels what the estimate is off by
    bias = force[:, : max(1, impact - excluded)].mean(axis=1)
    net = -_smooth((force - bias[:, None]).sum(axis=0), half)
    before = slice(max(0, impact - 2 * half), max(1, impact - half))  # the detection is some ms behind the contact
    ante = dq[:, before].mean(axis=1)
    down = _set_down(net[:, 2], impact + round(LIFTED_S / period_s), release) - round(EARLIER_S / period_s)
    return ExpectedImpact(impact * period_s, q[:, impact].copy(), ante, post, net, down * period_s, release * period_s)


def planned_impact(
    q: Array, dq: Array, force: Array, height: Array, impact: int, release: int, period_s: float
) -> ExpectedImpact:
    """Return the impact of a plan: q, dq (2, n, 7), force (2, n, 3) ON the pads, N, along the world's axes; height (n,)
    m: of what is carried; impact: index of the first post-impact point, at which the velocities jump."""
    post = dq.copy()
    post[:, :impact] = dq[:, impact, None]
    lifted = height[impact:release] - height[impact]
    up = np.flatnonzero(lifted > min(NEAR_TABLE_M, 0.5 * lifted.max()))
    down = impact + int(up[-1]) - round(EARLIER_S / period_s)
    return ExpectedImpact(
        impact * period_s, q[:, impact].copy(), dq[:, impact - 1].copy(), post, -force.sum(axis=0), down * period_s,
        release * period_s,
    )  # fmt: skip


def _set_down(lift: Array, lifted: int, release: int) -> int:
    """Index at which an object that hangs in the air at `lifted` meets the table: what is lifted (n,), N, changes."""
    carried = lift[lifted:release]
    if len(carried) == 0:
        return release
    weight = np.median(carried[: len(carried) // 2 + 1])
    changed = np.flatnonzero(np.abs(carried - weight) > CARRIED_SHARE * abs(weight))
    return lifted + int(changed[0]) if len(changed) else release


def _smooth(values: Array, half: int) -> Array:
    """Mean over 2 half + 1 ticks of values (n, k), the ends held."""
    padded = np.concatenate([np.repeat(values[:1], half, axis=0), values, np.repeat(values[-1:], half, axis=0)])
    total = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), padded]), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


# a robot ends torque control after 20 lost packets: a longer gap is no recording of one motion
LARGEST_GAP_NS = 21_000_000
MOVING = 1e-3  # m/s and rad/s: less is no motion of a hand
_TOLD_TICKS = 250  # between two words about the progress
WAITING_NS = 300_000_000  # of rest that is kept before the first motion: a scripted demonstration has as much


# what was measured beside a point, or planned: joints rad, rad/s; force ON the pad, N along the world's axes
MEASURED = np.dtype([("q", "f8", 7), ("dq", "f8", 7), ("force", "f8", 3)])
# as much as the geometry of real arms may be off (rtstack.cells.metal); what a calibration corrects by less is
# no other place
MOVED_M = 3e-3
# both pads so far off, and 4 mm by which pads and object give way, as the most yielding object of our cell does
GRIP_OFF_M = 0.01
_LOOKS = 20  # along the recording
_FEWEST_HELD = 50  # ticks


def described_in(log: Log) -> CellDescription | None:
    """Return the cell by the file that is attached to a log; None where it has none, or one of another version."""
    attached = log.attachment("cell.toml")
    try:
        return from_document(tomllib.loads((attached or b"").decode()), CellDescription, str(log.path))
    except (ConfigurationError, ValueError):
        return None


def check_sides(log: Log, sides: Sequence[str]) -> None:
    """Raise ReferenceError for a log that does not have the arms of these sides alone."""
    if tuple(log.sides) != tuple(sides):
        has, needs = (f"the {' and the '.join(each)} arm{'s' * (len(each) > 1)}" for each in (log.sides, sides))
        raise ReferenceError(f"{log.path}: it is of {has}, and the cell has {needs}: follow one of the same arms")


def grip_off_m(then: CellDescription | None, object_name: str, points: NDArray, held: NDArray[np.intp]) -> float:
    """Return the distance between the pad faces minus the width of the held object, m, along the line between the pads;
    0 if unknown. points (2, n) of POINT; held: of them, where both pads felt it."""
    thing = None if then is None else then.objects.get(object_name)
    if thing is None or len(points) < 2 or len(held) < _FEWEST_HELD:
        return 0.0
    out = points["rotation"][:, held][..., 2]  # of the faces
    along = out[0] - out[1]
    along /= np.linalg.norm(along, axis=1)[:, None]
    gap = np.median(((points["position"][1, held] - points["position"][0, held]) * along).sum(axis=1))
    return float(min((gap - width for width in thing.size), key=abs))


def moved_m(
    then: CellDescription | None, arms: Sequence[ArmController], q: Array, sides: Sequence[str] = SIDES
) -> float:
    """Return the largest distance of the pads from where they were when the log was made, m; 0 where it has no file.
    q (arms, n, 7): the recorded joints, rad, of the arms of these sides."""
    if then is None or not set(sides) <= set(then.sides):
        return 0.0
    looks = np.linspace(0, q.shape[1] - 1, _LOOKS).astype(int)
    away = 0.0
    for arm, mounting, own in zip(arms, (then.mountings[side] for side in sides), q[:, looks], strict=True):
        before = ArmModel(replace(mounting, model=arm.model.robot.reference), then.pad)
        for row in own:
            away = max(away, float(np.linalg.norm(_face(arm.model, row) - _face(before, row))))
    return away


def _face(model: ArmModel, q: Array) -> Array:
    model.update(np.ascontiguousarray(q), np.zeros(7))
    return model.p7 + model.R7 @ model.face


class ReferenceError(Exception):
    """A recording from which no reference can be made. The message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Recording:
    """The teleoperated part of a recording, one sample a tick.

    points (arms, n) of POINT: measured pose, twist and posture, wanted wrench and posture acceleration; impact,
    release: indices of the nominal impact T_r and the release. load (arms, 6) N, Nm: step of each arm's feedforward at
    T_r (a plan). detected: index of the impact that was found; problem: why no reference can be made of it; measured
    (arms, n) of MEASURED: also as planned. begin_s: cut off before the first sample; whole (arms, m) of POINT: without
    cutting, for `patient`. hits: index of each pad's impact. None: not known, or not found.
    """

    points: NDArray[np.void]
    period_s: float
    impact: int
    release: int
    object: str
    motion: Motion = Motion.GRAB
    load: NDArray[np.float64] | None = None
    detected: int | None = None
    problem: str | None = None
    measured: NDArray[np.void] | None = None
    begin_s: float = 0.0
    whole: NDArray[np.void] | None = None
    hits: tuple[int | None, ...] = (None, None)

    @property
    def impact_s(self) -> float:
        """Nominal impact time T_r, s since the start of the recording."""
        return self.impact * self.period_s

    def expected_impact(self, excluded: int) -> ExpectedImpact | None:
        """Return what the monitor is to expect, None for a push: it judges what both arms do to one object.

        excluded: ticks after T_r in which velocities are no reference.
        """
        if self.measured is None or self.motion is not Motion.GRAB:
            return None
        m = self.measured
        if self.load is not None:
            height = self.points["position"][:, :, 2].mean(axis=0)
            return planned_impact(m["q"], m["dq"], m["force"], height, self.impact, self.release, self.period_s)
        return demonstrated_impact(m["q"], m["dq"], m["force"], self.impact, self.release, excluded, self.period_s)


def reference_log(path: Path) -> Log:
    """Read a log that references are made of. Raises ReferenceError with one line."""
    try:
        return read_log(path)
    except LogError as error:
        raise ReferenceError(str(error)) from None


def load_recording(
    path: Path,
    arms: Sequence[ArmController],
    detector: DetectorParameters,
    period_s: float,
    sides: Sequence[str] = SIDES,
) -> Recording:
    """Read a recording of the arms of these sides and find its impact. Raises ReferenceError with one line."""
    return recording_of(reference_log(path), arms, detector, period_s, sides=sides)


def recording_of(
    log: Log, arms: Sequence[ArmController], detector: DetectorParameters, period_s: float,
    acceptance: Acceptance | None = None, patient: bool = False, progress: Callable[[float], None] | None = None,
    sides: Sequence[str] = SIDES,
) -> Recording:  # fmt: skip
    """Return the recording in an open log, as load_recording does. acceptance: by default what is kept beside it.
    patient: return one that cannot be followed too, whole and with its problem. progress: receives the share done."""
    path = log.path
    check_sides(log, sides)
    try:
        accepted = load_acceptance(path) if acceptance is None else acceptance
    except AcceptanceError as error:
        raise ReferenceError(str(error)) from None
    controls = [log.topic(f"/{side}/control") for side in sides]
    samples = [log.topic(f"/{side}/arm") for side in sides]
    taught = controls[0]["t_ns"][controls[0]["mode"] == Mode.TELEOPERATION]
    if len(taught) == 0:
        raise ReferenceError(f"{path}: nothing in it was teleoperated: record a demonstration with `rtstack teach`")
    period_ns = round(period_s * 1e9)
    taught = taught[taught >= _begun_ns(log, controls, taught[0])]
    grid_ns = np.arange(taught[0], taught[-1] + 1, period_ns)
    kept = _kept(path, accepted, len(grid_ns), period_s)
    begin, taught = kept.start, taught[(taught >= grid_ns[kept.start]) & (taught <= grid_ns[kept.stop - 1])]
    if not patient:
        grid_ns, kept = grid_ns[kept], slice(0, kept.stop - kept.start)
    for topic in (*controls, *samples):
        within = topic["t_ns"][(topic["t_ns"] >= taught[0]) & (topic["t_ns"] <= taught[-1])]
        gap_ns = int(np.max(np.diff(within), initial=0)) if len(within) > 1 else taught[-1] - taught[0] + period_ns
        if gap_ns > LARGEST_GAP_NS:
            raise ReferenceError(f"{path}: {gap_ns * 1e-6:.0f} ms of the demonstration are missing: record it again")
    n = len(grid_ns)
    points = np.zeros((len(arms), n), POINT)
    measured = np.zeros((len(arms), n), MEASURED)
    hits = [kept.stop] * len(arms)
    for arm, controller in enumerate(arms):
        finder = ImpactDetector(detector, period_s)
        q, dq, push = (_on_grid(samples[arm], name, grid_ns) for name in ("q", "dq", "O_F_ext_hat_K"))
        # views of single fields: looking one up in each tick costs more than the model does
        sample, work = controller.sample[0], controller.workspace[0]
        states = tuple(zip((sample[name] for name in ("q", "dq", "O_F_ext_hat_K")), (q, dq, push), strict=True))
        felt, velocity = work["force_world"], work["twist"][:3]
        seen = [(points[name][arm], work[name]) for name in ("position", "rotation", "twist")]
        seen.append((measured["force"][arm], felt))
        for k in range(n):
            for now, values in states:
                now[:] = values[k]
            controller.observe()
            for rows, value in seen:
                rows[k] = value
            if kept.start <= k < kept.stop and finder.update(felt, velocity):
                hits[arm] = min(hits[arm], k)
            if progress is not None and k % _TOLD_TICKS == 0:
                progress((arm + k / n) / len(arms))
        measured["q"][arm], measured["dq"][arm] = q, dq
        joint = controller.parameters.posture_joint
        points[arm]["xi"], points[arm]["dxi"] = q[:, joint], dq[:, joint]
        points[arm]["wrench_ff"] = _on_grid(controls[arm], "wrench_desired", grid_ns)
        points[arm]["beta"] = _on_grid(controls[arm], "beta", grid_ns)
    whole, n = points if patient else None, kept.stop - kept.start
    points, measured = points[:, kept], measured[:, kept]
    detected = min(hits) - kept.start if min(hits) < kept.stop else None
    by_hand_s = accepted.nominal_impact_s  # what a person has set comes before what was found
    impact = detected if by_hand_s is None else round(by_hand_s / period_s) - begin
    force = np.linalg.norm(measured["force"], axis=2).min(axis=0)  # on the pad that feels less, N
    held = np.flatnonzero(force > detector.force_high_n)
    problem, then, thing = None, described_in(log), log.metadata.get("trial", {}).get("object", "")
    if impact is None:
        problem = "no impact was found in the demonstration: record one that hits the object"
        if (accepted.from_s, accepted.to_s) != (None, None):
            problem = "no impact is in the part that is used: widen the part"
    elif impact < 0:
        problem = f"its impact was set to {by_hand_s:g} s, before {begin * period_s:g} s: cut less off"
    elif impact >= n:
        end_s = (begin + n) * period_s
        problem = f"its impact was set to {by_hand_s:g} s by hand, past its end at {end_s:g} s"
    elif accepted.verdict is AcceptanceState.REJECTED and not patient:
        problem = "this recording was rejected: follow another one"
    elif (away_m := moved_m(then, arms, measured["q"], sides)) > MOVED_M:
        where = "it was made with bases and pads elsewhere than the cell's file has them now"
        problem = f"{where}: its pads would be up to {away_m * 1e3:.0f} mm off; record it again"
    elif abs(off_m := grip_off_m(then, thing, points, held[held >= impact])) > GRIP_OFF_M:
        how = "further apart" if off_m > 0.0 else "nearer together"
        problem = (
            f"while both pads held the {thing}, they were {abs(off_m) * 1e3:.0f} mm {how} by the cell's file than it "
            "is wide: a base or a pad is elsewhere (rtstack calibrate), or the object has another size"
        )
    if problem is not None and not patient:
        raise ReferenceError(f"{path}: {problem}")
    impact = n if impact is None or problem is not None else impact
    held = held[held >= impact]
    release = int(held[-1]) if len(held) else impact
    return Recording(
        points, period_s, impact, release, thing, detected=detected, problem=problem, measured=measured,
        begin_s=begin * period_s, whole=whole,
        hits=tuple(hit - kept.start if hit < kept.stop else None for hit in hits),
    )  # fmt: skip


def _kept(path: Path, accepted: Acceptance, n: int, period_s: float) -> slice:
    """Return which ticks of a recording are used. Raises ReferenceError where they are none."""
    first = 0 if accepted.from_s is None else round(accepted.from_s / period_s)
    last = n if accepted.to_s is None else min(n, round(accepted.to_s / period_s))
    if last - first < 2:
        cut = f"it is cut to {first * period_s:g} to {last * period_s:g} s"
        raise ReferenceError(f"{path}: {cut}: nothing is left of its {n * period_s:g} s; cut less off")
    return slice(first, last)


def _begun_ns(log: Log, controls: list[NDArray], first_ns: int) -> int:
    """Return when a recording begins, ns: by hand it begins a moment before the first motion, not with the waiting."""
    if log.metadata.get("trial", {}).get("kind") != "recording":
        return first_ns
    moving = [np.flatnonzero(np.abs(topic["twist_ref"]).max(axis=1, initial=0.0) > MOVING) for topic in controls]
    starts = [int(topic["t_ns"][rows[0]]) for topic, rows in zip(controls, moving, strict=True) if len(rows)]
    return max(first_ns, min(starts, default=first_ns) - WAITING_NS)


def _on_grid(records: NDArray, name: str, grid_ns: NDArray[np.int64]) -> Array:
    """Return a field at the times of the grid: as recorded, and on a straight line across ticks that were missed."""
    values = records[name].reshape(len(records), -1)
    on_grid = np.stack([np.interp(grid_ns, records["t_ns"], column) for column in values.T], axis=1)
    return on_grid[:, 0] if records[name].ndim == 1 else on_grid
