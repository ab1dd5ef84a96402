"""What can go wrong, by the name that a faults file gives as `kind`, with its own keys: see docs/fault_scripts.md."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated, ClassVar, dataclass_transform

from pydantic import Field

from hal.robot_errors import ROBOT_ERRORS
from hal.state import ARM_STATE, RobotMode

_Force = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Torque = Annotated[float, Field(ge=-200.0, le=200.0)]
_Torques = tuple[_Torque, _Torque, _Torque, _Torque, _Torque, _Torque, _Torque]
_Factor = Annotated[float, Field(ge=0.0, le=100.0)]
_Acceleration = Annotated[float, Field(ge=-100.0, le=100.0)]
_LONGEST_MS = 60_000.0

KINDS: dict[str, type["Effect"]] = {}


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Effect:
    """What goes wrong. A subclass is made a dataclass; its fields are the kind's own keys. of_an_arm: it names an arm;
    lasts: it has a duration; of_the_link: it needs the Franka Control Interface."""

    kind: ClassVar[str]
    of_an_arm: ClassVar[bool]
    lasts: ClassVar[bool]
    of_the_link: ClassVar[bool]

    def __init_subclass__(
        cls, kind: str, of_an_arm: bool = True, lasts: bool = True, of_the_link: bool = False
    ) -> None:
        cls.kind, cls.of_an_arm, cls.lasts, cls.of_the_link = kind, of_an_arm, lasts, of_the_link
        KINDS[kind] = dataclass(frozen=True)(cls)


class Push(Effect, kind="push"):
    """A force on the pad's face, along the world's axes."""

    force_N: tuple[_Force, _Force, _Force]


class JointPush(Effect, kind="joint_push"):
    """An outer torque on the joints."""

    torque_Nm: _Torques


class Slip(Effect, kind="slip"):
    """The pad loses its grip."""

    friction_factor: _Factor


class ObjectLost(Effect, kind="object_lost", of_an_arm=False, lasts=False):
    """The object is gone."""


class ObjectMass(Effect, kind="object_mass", of_an_arm=False):
    """The object is heavier or lighter than it looks."""

    mass_factor: Annotated[float, Field(ge=0.01, le=100.0)]


class ObjectTilted(Effect, kind="object_tilted", of_an_arm=False, lasts=False):
    """Something lies under the object: its sides are not upright. Positive: the left arm's edge is the higher one."""

    tilt_deg: Annotated[float, Field(ge=-20.0, le=20.0)]  # steeper, it would slide off its wedge


class FrictionChange(Effect, kind="friction_change"):
    """The joints run more smoothly, or bind."""

    friction_factor: _Factor


class TauSensorBias(Effect, kind="tau_sensor_bias"):
    """The joint torque sensors are off."""

    bias_Nm: _Torques


class Reflex(Effect, kind="reflex"):
    """The robot stops itself."""

    error: str

    def __post_init__(self) -> None:
        if self.error not in ROBOT_ERRORS:
            raise ValueError(f"error {self.error!r} is none of the vendor's: see hal/robot_errors.py")


class BaseShaken(Effect, kind="base_shaken"):
    """What the arm stands on is shaken, or the accelerometer in its base is broken."""

    acceleration: tuple[_Acceleration, _Acceleration, _Acceleration]


class UserStop(Effect, kind="user_stop"):
    """The external activation device is pressed."""


# what the arm shows meanwhile. For those that are no mode of libfranka's own nothing is published: Other, as of an arm
# that gives no control
MODES = {
    "guiding": RobotMode.GUIDING,
    "brakes_locked": RobotMode.OTHER,
    "fci_off": RobotMode.OTHER,
    "self_test_due": RobotMode.OTHER,
    "safety_function": RobotMode.USER_STOPPED,  # libfranka issue 128
}


class Mode(Effect, kind="mode"):
    """The arm is in a mode out of which only a person leads."""

    state: str

    def __post_init__(self) -> None:
        if self.state not in MODES:
            raise ValueError(f"state {self.state!r} is none of {', '.join(MODES)}")

    @property
    def robot_mode(self) -> RobotMode:
        return MODES[self.state]

    @property
    def unsafe(self) -> bool:
        """Whether it is a safety function that refuses, and requests are answered so."""
        return self.state in ("self_test_due", "safety_function")


class StateFrozen(Effect, kind="state_frozen"):
    """The robot repeats itself."""


class StateNan(Effect, kind="state_nan"):
    """The robot reports nonsense."""

    field: str

    def __post_init__(self) -> None:
        if self.field not in (ARM_STATE.names or ()) or ARM_STATE[self.field].base.kind != "f":
            raise ValueError(f"field {self.field!r} is none of the state's numbers: see hal/state.py")


class TimeBack(Effect, kind="time_back"):
    """The robot's clock jumps back. libfranka takes no notice of a state that is older than the last one."""

    back_ms: Annotated[float, Field(ge=1.0, le=_LONGEST_MS)]


class StatesLost(Effect, kind="states_lost", of_the_link=True):
    """The way to the client is cut."""


class AnswersLost(Effect, kind="answers_lost", of_the_link=True):
    """The way from the client is cut."""


class Disconnect(Effect, kind="disconnect", lasts=False, of_the_link=True):
    """The connection is closed."""


class Stall(Effect, kind="stall", of_an_arm=False, lasts=False, of_the_link=True):
    """The server stands still."""

    stall_ms: Annotated[float, Field(ge=0.0, le=_LONGEST_MS)]


class TrackerLost(Effect, kind="tracker_lost", of_an_arm=False):
    """The object is hidden from the cameras."""


class TrackerFrozen(Effect, kind="tracker_frozen", of_an_arm=False):
    """Motion capture repeats itself."""


class Origin(Enum):
    """What a fault's delay counts from."""

    START = "start"  # of the server
    MOTION = "motion"  # the first ms in which any arm is in motion
    FIRST_CONTACT = "first_contact"  # the first ms after any pad has touched the object


@dataclass(frozen=True, slots=True)
class ScriptedFault:
    """One entry of the script. sides: indices of the cell's arms. duration_ms: None lasts to the end."""

    effect: Effect
    sides: tuple[int, ...]
    origin: Origin
    delay_ms: int
    duration_ms: int | None
