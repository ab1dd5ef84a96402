"""Where a trial's references come from: a recording of a demonstration, or a plan. The trial need not know which."""

from collections.abc import Sequence
from pathlib import Path

from rtstack.control.parameters import DetectorParameters
from rtstack.control.tick import ArmController
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.references.planned import PLAN, planned_recording, planned_reference
from rtstack.references.recording import ReferenceError, check_sides, recording_of
from rtstack.references.spreading import ExtendedReference, extend
from rtstack.samples import SIDES


def load_reference(
    path: Path, arms: Sequence[ArmController], detector: DetectorParameters, sides: Sequence[str] = SIDES
) -> ExtendedReference:
    """Read a file of `rtstack teach` or `rtstack plan`. sides: of the arms. Raises ReferenceError with one line, also
    where the file has other arms."""
    control = arms[0].parameters
    try:
        log = read_log(path)
    except LogError as error:
        raise ReferenceError(str(error)) from None
    check_sides(log, sides)
    if PLAN in log.metadata:
        return planned_reference(planned_recording(log, control.posture_joint, control.period_s))
    return extend(recording_of(log, arms, detector, control.period_s, sides=sides), control.exclusion_s)
