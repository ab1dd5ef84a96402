"""What the judge answers, and why: two enumerations, each reason with its one line of text."""

from enum import IntEnum


class Judgement(IntEnum):
    """What became of the desired torque."""

    PASS = 0
    LIMITED = 1
    STOPPING = 2


class Cause(IntEnum):
    """Why the judge limited or stopped. `text` is one line for people, `unit` that of the measured value."""

    text: str
    unit: str

    def __new__(cls, code: int, text: str, unit: str = "") -> "Cause":
        """Return the member; its text and unit travel with it."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.text, member.unit = text, unit
        return member

    NONE = 0, "nothing"
    COMMANDED = 1, "a stop was asked for"  # not an intervention
    TORQUE = 2, "the desired torque is beyond the joint's", "Nm"
    TORQUE_RATE = 3, "the desired torque steps further than the robot accepts", "Nm"
    NOT_FINITE = 4, "a value of the state or the desired torque is not finite"
    JOINT_POSITION = 5, "the joint cannot stop before its position limit", "rad"
    JOINT_VELOCITY = 6, "the joint is faster than its position allows", "rad/s"
    MEASURED_TORQUE = 7, "the measured torque is beyond the joint's range", "Nm"
    CONTROLLER = 8, "the controller has no torque: its QP was not solved"
    EXTERNAL_TORQUE = 9, "the estimated external torque is too large", "Nm"
    RESIDUAL = 10, "the momentum residual is too large", "Nm"
    WORKSPACE = 11, "the end effector has left its box", "m"
    SPEED = 12, "the end effector is too fast", "m/s"
    POWER = 13, "the mechanical power is too large", "W"
    ARM_DISTANCE = 14, "the arms are too close to each other", "m"
    STATE_GAP = 15, "states are missing", "s"
    STATE_AGE = 16, "the state is stale: it does not change any more", "s"
    TIME_BACKWARDS = 17, "the robot's time ran backwards", "s"
    PAIR_SKEW = 18, "the other arm has shown no new state", "s"
    OTHER_ARM = 19, "the other arm is stopping"  # not an intervention of its own
    FORCE = 20, "the pad pushes harder than this phase allows", "N"


# a stop for one of these was not the judge's own idea
NO_INTERVENTION = frozenset((Cause.NONE, Cause.COMMANDED, Cause.OTHER_ARM))
