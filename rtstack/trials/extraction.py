"""What a recording gives: the impact that was found in it, and the references that are made of it, as in Figure 5."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.references.acceptance import Acceptance
from rtstack.references.recording import ReferenceError, recording_of
from rtstack.references.spreading import ExtendedReference, extend
from rtstack.references.worth import Remark, remarks_on
from rtstack.samples import SIDES
from rtstack.trials.assembly import arm_controllers, cell_parameters

AROUND_S = 0.4  # of the impact: what is drawn closely
_POINTS = 800  # of the whole recording, thinned out


@dataclass(frozen=True, slots=True)
class Curve:
    """One quantity of one arm, along the world's y: recorded, and extended before and after the impact."""

    recorded: list[float]
    ante: list[float]
    post: list[float]


@dataclass(frozen=True, slots=True)
class Extraction:
    """t_s: times of the curves around the impact; velocity m/s and force N of (left, right); whole_*: of all of it.

    problem: why no reference can be made; the curves are empty then. detected_impact_s: None where none was found.
    Times are s since the recording's start; begin_s, end_s: what is used of it, and duration_s: how long that is.
    remarks: what is good and bad about it as a reference.
    """

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
    """Make the references of a recording, with what was said about it. ReferenceError: it is none at all.

    progress: is told the share that is done.
    """
    parameters = cell_parameters(description)
    control = parameters.control
    arms = arm_controllers(description, parameters)
    # shown whatever was decided about it
    try:
        log = read_log(path)
    except LogError as error:
        raise ReferenceError(str(error)) from None
    recording = recording_of(log, arms, parameters.detector, control.period_s, acceptance, True, progress)
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
        for arm, side in enumerate(SIDES):
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
        whole_velocity={side: whole[arm]["twist"][::step, 1].tolist() for arm, side in enumerate(SIDES)},
        whole_force={side: whole[arm]["wrench_ff"][::step, 1].tolist() for arm, side in enumerate(SIDES)},
        remarks=list(remarks_on(recording, control.exclusion_s)),
    )
