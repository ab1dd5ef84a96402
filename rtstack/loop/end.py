"""How a session ended: the one line that the operator, the result and the log read first."""

from enum import StrEnum


class End(StrEnum):
    """How a session ended."""

    COMPLETED = "completed"
    STOP_REQUESTED = "stop requested by the operator"
    NO_IMPACT = "no impact was detected"
    UNEXPECTED_IMPACT = "another impact than was meant"
    CRASH = "something was hit that was not meant"  # it may have been a person: an operator must look before going on
    SAFETY = "safety stop"
    QP = "the QP was not solved"
    HARDWARE = "the robot left torque control"
    CONSOLE_GONE = "the console has gone"
    OPERATOR_GONE = "the operator has gone"
    RELEASED = "the operator let go"
    CLUTCH_QUIET = "the clutch has gone quiet"
    POLICY_QUIET = "the policy has gone quiet"
    PARENT_GONE = "the process that started this one has gone"
    LOG_FAILED = "the log is not being written"
    TICK_OVERRUN = "the tick takes longer than its period"
    TORQUE_NOT_TAKEN = "one arm does not take its torque"
    CONTROLLER_EXCEPTION = "an exception in the control loop"
    NOT_AT_REST = "the arms did not come to rest"

    @classmethod
    def in_reason(cls, reason: str | None) -> "End":
        """Return the end that a failure's reason begins with (SessionOutcome.problem); COMPLETED without one."""
        found = [end for end in cls if reason is not None and (reason == end or reason.startswith(f"{end}: "))]
        return found[0] if found else cls.COMPLETED

    @property
    def is_fault(self) -> bool:
        """Whether an operator must recover: not after a trial that finds no impact, or a lighter object."""
        return self not in (End.COMPLETED, End.STOP_REQUESTED, End.NO_IMPACT, End.UNEXPECTED_IMPACT, End.RELEASED)


# ends that do not follow from the states: a person, a process or a disk has asked for them
OUTSIDE = frozenset(
    (
        End.STOP_REQUESTED, End.CONSOLE_GONE, End.OPERATOR_GONE, End.RELEASED, End.CLUTCH_QUIET, End.POLICY_QUIET,
        End.PARENT_GONE, End.LOG_FAILED,
    )
)  # fmt: skip
