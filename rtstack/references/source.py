"""Where a trial's references come from: a recording of a demonstration, or a plan. The trial need not know which."""

from collections.abc import Sequence
from pathlib import Path

from rtstack.control.parameters import DetectorParameters
from rtstack.control.tick import ArmController
from rtstack.references.planned import PLAN, planned_recording, planned_reference
from rtstack.references.recording import check_sides, recording_of, reference_log
from rtstack.references.spreading import ExtendedReference, extend
from rtstack.samples import SIDES


def load_reference(
    path: Path, arms: Sequence[ArmController], detector: DetectorParameters, sides: Sequence[str] = SIDES
) -> ExtendedReference:
    """Read a file of `rtstack teach` or `rtstack plan`. sides: of the arms. Raises ReferenceError with one line, also
    where the file has other arms."""
    control = arms[0].parameters
    log = reference_log(path)
    check_sides(log, sides)
    if PLAN in log.metadata:
        return planned_reference(planned_recording(log, control.posture_joint, control.period_s))
    return extend(recording_of(log, arms, detector, control.period_s, sides=sides), control.exclusion_s)
