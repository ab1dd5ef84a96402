"""Cases that have to be missed: run by the matrix's own test."""

import subprocess
import sys

from rtstack.samples import Mode
from tests.programs import fault_matrix as matrix
from tests.programs import program
from tests.support.faults import catalogue as fault_catalogue
from tests.support.faults import injection as injected
from tests.support.faults import model as fault_model
from tests.support.faults.model import Expected, Fault, Moment, Performed, Reaction
from tests.support.faults.stage import Stage

STOP = Expected((Reaction.STOP,), "not finite")


def leave_somebody_behind(stage: Stage) -> None:
    """Start a process that nobody ends."""
    subprocess.Popen(["sleep", "600"], start_new_session=True)
    injected.nan_torque(stage)


FAULTS = (
    Fault("nothing is brought about", "", Performed(lambda stage: None), STOP, STOP),
    Fault("another reason", "", Performed(injected.nan_torque), Expected((Reaction.STOP,), "the moon"), STOP),
    Fault("no trace", "", Performed(injected.nan_torque), STOP, STOP, proof=lambda stage: False),
    Fault("orphan", "", Performed(leave_somebody_behind), STOP, STOP),
)
LATE = Fault("too late", "", Performed(injected.nan_torque), STOP, STOP)
ELSEWHERE = Fault("another moment", "", fault_catalogue.Scripted('kind = "disconnect"\narm = "left"'), STOP, STOP)


def main() -> None:
    """Play all of them in the teleoperation or ante-impact mode, two of them with a moment that is wrong."""
    fault_model.MODES[Moment.INTERIM] = (Mode.INTERIM, 200)  # its end is 100 ticks before
    fault_catalogue.FAULTS = (*FAULTS, LATE, ELSEWHERE)
    cases = [f"{matrix.case_name(fault, Moment.TELEOPERATION)}" for fault in FAULTS]
    cases += [matrix.case_name(fault, Moment.INTERIM) for fault in (LATE, ELSEWHERE)]
    program(matrix.main, [*sys.argv[1:], *(word for case in cases for word in ("--case", case))])


if __name__ == "__main__":
    main()
