"""What can go wrong, by the name that a faults file gives as `kind`, with the kind's own keys.

| kind             | own keys        | what happens                                                                    |
| ---------------- | --------------- | ------------------------------------------------------------------------------- |
| push             | force_N         | a force, (3,) N along the world's axes, on the face of the arm's pad            |
| joint_push       | torque_Nm       | an outer torque, (7,) Nm, on the link side of the joints                        |
| slip             | friction_factor | the friction between the arm's pad and the object, times this                   |
| object_lost *    | -               | the object is taken away for good; the tracker sees it no more                  |
| object_mass *    | mass_factor     | the object's mass and inertia, times this                                       |
| object_tilted *  | tilt_deg        | the object stands on a wedge, turned about the world's x, from the start        |
| friction_change  | friction_factor | the friction of the arm's joints, times this                                    |
| tau_sensor_bias  | bias_Nm         | added to the joint torque sensors, (7,) Nm; the torque loop believes it         |
| reflex           | error           | the vendor's error of that name; recovery is refused for `duration_s`           |
| base_shaken      | acceleration    | added to what the accelerometer in the arm's base reads, (3,) m/s^2             |
| user_stop        | -               | the external activation device is pressed: the arm brakes, and refuses Move     |
| mode             | state           | the arm needs a person: `guiding` by hand, `brakes_locked`, `fci_off` (refuses  |
|                  |                 | connections), `self_test_due`, `safety_function` (a rule of Watchman's)         |
| state_frozen     | -               | the same state again and again, under rising time                               |
| state_nan        | field           | this value of the state is no number: q, dq, tau_J, ... (all of its elements)   |
| time_back        | back_ms         | the states' time stamps are set back by so much                                 |
| states_lost +    | -               | the arm's client is sent no state                                               |
| answers_lost +   | -               | the commands of the arm's client are dropped, as if they had come too late      |
| disconnect +     | -               | the TCP connection of the arm's client is closed                                |
| stall * +        | stall_ms        | the whole robot server stands still, in ms of wall-clock time                   |
| tracker_lost *   | -               | motion capture has no new frames of the object                                  |
| tracker_frozen * | -               | motion capture repeats its last pose under rising time                          |

Keys of every kind: `arm` = left, right or both, of those that the cell has (none for kinds with *); the moment, which
is either `at_s`, the robot's time since the first motion of any arm, or `when = "first_contact"` (of a pad with the
object) and `delay_s` after it; `duration_s`, to the end when left out. A `mode` without a moment is there from the
start. object_lost, disconnect and stall have no duration, object_tilted neither that nor a moment, and a reflex without
one is over at once, though latched. Kinds with + need the Franka Control Interface between robot and client.

Time is the plant's, in ms: a fault at 0.1 s acts on the ms that follows the state at 0.1 s, and the state after it is
the first that shows, freezes or loses anything, and whose answer is the first that is lost. In lockstep the plant
stands still while no arm moves: nothing begins then, and what is active goes on with each state that is repeated. There
a client that is sent no state of one arm is still waited for on the other arm.
"""

from dataclasses import dataclass, fields
from enum import Enum
from typing import ClassVar

from hal.base.arrays import Seven
from hal.robot_errors import ROBOT_ERRORS
from hal.state import ARM_STATE, RobotMode
from sim_robot.scene import Vector3

LARGEST_FORCE_N = 1000.0
LARGEST_TORQUE_NM = 200.0
LARGEST_FACTOR = 100.0
SMALLEST_MASS_FACTOR = 0.01
LARGEST_TILT_DEG = 20.0  # steeper, it would slide off its wedge
LARGEST_STALL_MS = 60_000.0
LARGEST_ACCELERATION = 100.0  # m/s^2

KINDS: dict[str, type["Effect"]] = {}


@dataclass(frozen=True)
class Effect:
    """What goes wrong; its fields are the kind's own keys. of_an_arm: it names an arm; lasts: it has a duration;
    of_the_link: it needs the Franka Control Interface; bounds: of all of its numbers."""

    kind: ClassVar[str]
    of_an_arm: ClassVar[bool]
    lasts: ClassVar[bool]
    of_the_link: ClassVar[bool]
    bounds: ClassVar[tuple[float, float]]

    def __init_subclass__(
        cls,
        kind: str,
        bounds: tuple[float, float] = (0.0, 0.0),
        of_an_arm: bool = True,
        lasts: bool = True,
        of_the_link: bool = False,
    ) -> None:
        cls.kind, cls.bounds, cls.of_an_arm, cls.lasts, cls.of_the_link = kind, bounds, of_an_arm, lasts, of_the_link
        KINDS[kind] = cls

    def __post_init__(self) -> None:
        lowest, largest = self.bounds
        for each in fields(self):
            given = getattr(self, each.name)
            for value in given if isinstance(given, tuple) else (given,):
                if not lowest <= value <= largest:
                    raise ValueError(f"{each.name} must be within {lowest:g} and {largest:g}, got {value:g}")


@dataclass(frozen=True)
class Push(Effect, kind="push", bounds=(-LARGEST_FORCE_N, LARGEST_FORCE_N)):
    """A force on the pad's face, along the world's axes."""

    force_N: Vector3


@dataclass(frozen=True)
class JointPush(Effect, kind="joint_push", bounds=(-LARGEST_TORQUE_NM, LARGEST_TORQUE_NM)):
    """An outer torque on the joints."""

    torque_Nm: Seven


@dataclass(frozen=True)
class Slip(Effect, kind="slip", bounds=(0.0, LARGEST_FACTOR)):
    """The pad loses its grip."""

    friction_factor: float


class ObjectLost(Effect, kind="object_lost", of_an_arm=False, lasts=False):
    """The object is gone."""


@dataclass(frozen=True)
class ObjectMass(Effect, kind="object_mass", bounds=(SMALLEST_MASS_FACTOR, LARGEST_FACTOR), of_an_arm=False):
    """The object is heavier or lighter than it looks."""

    mass_factor: float


@dataclass(frozen=True)
class ObjectTilted(
    Effect, kind="object_tilted", bounds=(-LARGEST_TILT_DEG, LARGEST_TILT_DEG), of_an_arm=False, lasts=False
):
    """Something lies under the object: its sides are not upright. Positive: the left arm's edge is the higher one."""

    tilt_deg: float


@dataclass(frozen=True)
class FrictionChange(Effect, kind="friction_change", bounds=(0.0, LARGEST_FACTOR)):
    """The joints run more smoothly, or bind."""

    friction_factor: float


@dataclass(frozen=True)
class TauSensorBias(Effect, kind="tau_sensor_bias", bounds=(-LARGEST_TORQUE_NM, LARGEST_TORQUE_NM)):
    """The joint torque sensors are off."""

    bias_Nm: Seven


@dataclass(frozen=True)
class Reflex(Effect, kind="reflex"):
    """The robot stops itself."""

    error: str

    def __post_init__(self) -> None:
        if self.error not in ROBOT_ERRORS:
            raise ValueError(f"error {self.error!r} is none of the vendor's: see hal/robot_errors.py")


@dataclass(frozen=True)
class BaseShaken(Effect, kind="base_shaken", bounds=(-LARGEST_ACCELERATION, LARGEST_ACCELERATION)):
    """What the arm stands on is shaken, or the accelerometer in its base is broken."""

    acceleration: Vector3


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


@dataclass(frozen=True)
class Mode(Effect, kind="mode"):
    """The arm is in a mode out of which only a person leads."""

    state: str

    def __post_init__(self) -> None:
        if self.state not in MODES:
            raise ValueError(f"state {self.state!r} is none of {', '.join(MODES)}")

    @property
    def robot_mode(self) -> RobotMode:
        """What the arm shows."""
        return MODES[self.state]

    @property
    def unsafe(self) -> bool:
        """Whether it is a safety function that refuses, and requests are answered so."""
        return self.state in ("self_test_due", "safety_function")


class StateFrozen(Effect, kind="state_frozen"):
    """The robot repeats itself."""


@dataclass(frozen=True)
class StateNan(Effect, kind="state_nan"):
    """The robot reports nonsense."""

    field: str

    def __post_init__(self) -> None:
        if self.field not in (ARM_STATE.names or ()) or ARM_STATE[self.field].base.kind != "f":
            raise ValueError(f"field {self.field!r} is none of the state's numbers: see hal/state.py")


@dataclass(frozen=True)
class TimeBack(Effect, kind="time_back", bounds=(1.0, LARGEST_STALL_MS)):
    """The robot's clock jumps back. libfranka takes no notice of a state that is older than the last one."""

    back_ms: float


class StatesLost(Effect, kind="states_lost", of_the_link=True):
    """The way to the client is cut."""


class AnswersLost(Effect, kind="answers_lost", of_the_link=True):
    """The way from the client is cut."""


class Disconnect(Effect, kind="disconnect", lasts=False, of_the_link=True):
    """The connection is closed."""


@dataclass(frozen=True)
class Stall(Effect, kind="stall", bounds=(0.0, LARGEST_STALL_MS), of_an_arm=False, lasts=False, of_the_link=True):
    """The server stands still."""

    stall_ms: float


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
