"""How far the simulated robot differs from an ideal one (docs/reference/simulated_robot.md); `ideal` changes no bit."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import exp, log
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeInt

from hal.base.arrays import Array, Seven
from hal.base.configuration import ConfigurationError, NotNegative, Positive, load_toml
from hal.tracker import ObjectPose, ObjectTracker
from sim_robot.plant_parameters import OWN_FILES, SevenNotNegative, Vector3
from sim_robot.scene import ArmPlacement, Scene

IDEAL = "ideal"
_PROFILES = OWN_FILES / "parameters" / "profiles"
LONGEST_DELAY_MS = 50
DelayMs = Annotated[int, Field(ge=0, le=LONGEST_DELAY_MS)]
# of the draws, beside 0 arms and placement, 1 sensors, 2 tracker, 3 friction of a campaign
ARM_DRAW, SLOW_NOISE_DRAW, TRACKER_DRAW, BOX_DRAW, LINK_DRAW = 4, 5, 6, 7, 8
LATE_SHARES = (0.5, 0.9, 0.99, 0.999)  # of the states that are no later than Twin.link_late_us
_NONE: Vector3 = (0.0, 0.0, 0.0)
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])  # of a unit quaternion


@dataclass(frozen=True, slots=True)
class Built:
    """Displacements mm along, and turns (rotation vectors) deg about the world's axes, of the bases about themselves.

    swapped: what answers as the left arm is the right one. tracker_mm, tracker_deg: of the tracker's frame in the
    world, which a robot on the wire gives its poses in; pivot_mm: of the body that it follows, in the object's frame.
    """

    left_mm: Vector3 = _NONE
    left_deg: Vector3 = _NONE
    right_mm: Vector3 = _NONE
    right_deg: Vector3 = _NONE
    tracker_mm: Vector3 = _NONE
    tracker_deg: Vector3 = _NONE
    pivot_mm: Vector3 = _NONE
    swapped: bool = False

    @property
    def moved_tracker(self) -> bool:
        """Whether the tracker's frame is not the world's, or the body not in the object's middle."""
        return any((*self.tracker_mm, *self.tracker_deg, *self.pivot_mm))

    def to_tracker(self, place: Array) -> Array:
        """Return a place of the world (3,), m, in the tracker's frame."""
        return _turned(_quaternion(self.tracker_deg) * _INVERSE, place - 1e-3 * np.array(self.tracker_mm))

    def body(self, position: Array, wxyz: Array) -> Array:
        """Return where the body that the tracker follows is in the world, (3,) m, for an object's pose there."""
        return position + _turned(wxyz, 1e-3 * np.array(self.pivot_mm))

    def tracker(self, tracker: ObjectTracker) -> ObjectTracker:
        """Return what a client is given: the tracker's poses in its own frame."""
        return MovedTracker(tracker, self) if self.moved_tracker else tracker

    def scene(self, scene: Scene) -> Scene:
        """Return the scene as it was built. Raises ConfigurationError where one arm is swapped."""
        if not any((*self.left_mm, *self.left_deg, *self.right_mm, *self.right_deg, self.swapped)):
            return scene
        left = scene.left and _moved(scene.left, self.left_mm, self.left_deg)
        right = scene.right and _moved(scene.right, self.right_mm, self.right_deg)
        if not self.swapped:
            return replace(scene, left=left, right=right)
        if left is None or right is None:
            raise ConfigurationError("the profile's built.swapped exchanges two arms, and this cell has one")
        return replace(scene, left=right, right=left)


def _moved(arm: ArmPlacement, mm: Vector3, deg: Vector3) -> ArmPlacement:
    x, y, z = (np.array(arm.T_world_base_position) + 1e-3 * np.array(mm)).tolist()
    wxyz = _product(_quaternion(deg), np.array(arm.T_world_base_wxyz))
    w, a, b, c = (wxyz / np.linalg.norm(wxyz)).tolist()
    return replace(arm, T_world_base_position=(x, y, z), T_world_base_wxyz=(w, a, b, c))


class MovedTracker:
    """An ObjectTracker that gives another one's poses in its own frame."""

    def __init__(self, tracker: ObjectTracker, built: Built) -> None:
        self._tracker, self._given, self._built = tracker, ObjectPose.empty(), built
        self._back = _quaternion(built.tracker_deg) * _INVERSE

    def latest(self) -> ObjectPose:
        pose, given = self._tracker.latest(), self._given
        given.record[:] = pose.record
        given.position[:] = self._built.to_tracker(self._built.body(pose.position, pose.orientation_wxyz))
        given.orientation_wxyz[:] = _product(self._back, pose.orientation_wxyz)
        return given


def _quaternion(deg: Vector3) -> Array:
    """Return the quaternion wxyz (4,) of a rotation vector, deg."""
    half = np.radians(deg) / 2.0
    angle = float(np.linalg.norm(half))
    return np.array([np.cos(angle), *(half * np.sinc(angle / np.pi))])


def _turned(wxyz: Array, v: Array) -> Array:
    return _product(_product(wxyz, np.array([0.0, *v])), wxyz * _INVERSE)[1:]


def _product(p: Array, q: Array) -> Array:
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


@dataclass(frozen=True, slots=True)
class ForceEstimate:
    """What is wrong with the estimate of external torques. Standard deviations of what is drawn once for an arm.

    torque_offset Nm, a joint; gravity_error: share of a joint's gravity torque; payload_error_kg: of what is on the
    flange, against what the robot was told. delay_ms: of the whole estimate. noise Nm: besides the white noise, below
    noise_hz.
    """

    torque_offset: SevenNotNegative
    gravity_error: NotNegative
    payload_error_kg: NotNegative
    delay_ms: DelayMs
    noise: SevenNotNegative
    noise_hz: NotNegative

    def __post_init__(self) -> None:
        if any(self.noise) and not self.noise_hz:
            raise ValueError("noise_hz must be positive where there is noise")


@dataclass(frozen=True, slots=True)
class OwnArm:
    """How the arm differs from its description in hal/robots, the controller's. Standard deviations, drawn for an arm.

    link_mass, link_inertia: fractions; link_centre_mm: each coordinate of a centre of mass: of the arm and of the URDF
    that it serves. friction: a fraction of each joint's, of the arm alone.
    """

    link_mass: NotNegative
    link_inertia: NotNegative
    link_centre_mm: NotNegative
    friction: NotNegative


@dataclass(frozen=True, slots=True)
class Twin:
    """An arm as it was identified (`rtstack twin`), in the place of what is drawn; None: drawn as ever.

    Joints as in JointParameters; gravity_factor: of the robot's own gravity compensation. payload_kg: on the flange,
    beside the pad that the scene has, below zero where the pad is lighter; payload_centre m: in the last link's frame.
    torque_offset Nm, estimate_delay_ms: of the estimate of external torques, instead of ForceEstimate's.
    contact_stiffness N/m: of the pad's whole face on an object, silicone and wall in series, whatever the object.
    link_late_us: by how much a state reaches its client later than the fastest do, quantiles at LATE_SHARES; of a robot
    that keeps real time.
    """

    B_theta: Seven | None = None
    K: Seven | None = None
    D: Seven | None = None
    friction_p1: Seven | None = None
    friction_p2: Seven | None = None
    friction_p3: Seven | None = None
    gravity_factor: Seven | None = None
    payload_kg: float = 0.0
    payload_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    torque_offset: Seven | None = None
    estimate_delay_ms: DelayMs | None = None
    contact_stiffness: Positive | None = None
    link_late_us: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        late = self.link_late_us
        if late is not None and not 0.0 <= late[0] <= late[1] <= late[2] <= late[3]:
            raise ValueError(f"link_late_us must not be negative nor fall: {list(late)}")


@dataclass(frozen=True, slots=True)
class TrackerClock:
    """A motion capture with a clock of its own. offset_ms, drift_ppm: at most, either way, drawn for a run.

    latency_ms: from the exposure to the robot's network, a Spread. lost_share: of the frames; lost_frames: how many in
    a row at most.
    """

    offset_ms: NotNegative
    drift_ppm: NotNegative
    latency_ms: tuple[float, float, float]
    lost_share: NotNegative
    lost_frames: NonNegativeInt

    def __post_init__(self) -> None:
        Spread(*self.latency_ms)
        if self.lost_share >= 1.0 or (self.lost_share and not self.lost_frames):
            raise ValueError("lost_share must be below 1, and lost_frames positive where frames are lost")


@dataclass(frozen=True, slots=True)
class Box:
    """How long the control box takes, ms, from the request's arrival to what it asks for: a Spread each.

    move_ms: until the motion has started; stop_ms: until it has ended, at a stop or at the client's own end; set_ms:
    each setting; recovery_ms: until the errors are cleared or the recovery is refused. first_command_ms: how long it
    waits from Move to the first command; 0: as plant.toml has it.
    """

    move_ms: tuple[float, float, float]
    stop_ms: tuple[float, float, float]
    set_ms: tuple[float, float, float]
    recovery_ms: tuple[float, float, float]
    first_command_ms: NonNegativeInt

    def __post_init__(self) -> None:
        for name in ("move_ms", "stop_ms", "set_ms", "recovery_ms"):
            Spread(*getattr(self, name))


@dataclass(frozen=True, slots=True)
class Spread:
    """A duration that differs from time to time: its logarithm is distributed as a triangle. All three in ms; 0: none.

    Few durations of a robot are published, and those as a range: a triangle claims no more than that and a usual value.
    """

    least: float
    usual: float
    most: float

    def __post_init__(self) -> None:
        given = (self.least, self.usual, self.most)
        if any(given) and not 0.0 < self.least <= self.usual <= self.most:
            raise ValueError(f"expected 0 < least <= usual <= most, or three zeros: {list(given)}")

    def draw(self, generator: np.random.Generator) -> float:
        """Return a duration, ms. Nothing is drawn where there is none."""
        if not self.most:
            return 0.0
        if self.least == self.most:
            return self.most
        return exp(generator.triangular(log(self.least), log(self.usual), log(self.most)))


@dataclass(frozen=True, slots=True)
class Profile:
    """Everything in which a simulated robot differs from an ideal one. left, right: identified arms."""

    force: ForceEstimate
    arm: OwnArm
    tracker: TrackerClock
    box: Box
    left: Twin = Twin()
    right: Twin = Twin()
    built: Built = field(default_factory=Built)

    def twins(self, sides: Sequence[str]) -> tuple[Twin, ...]:
        """Return the twins of the arms with these names, left or right."""
        return tuple(getattr(self, side) for side in sides)


def profile_names() -> tuple[str, ...]:
    """Return the names of the profiles, the ideal one first."""
    return tuple(sorted((file.stem for file in _PROFILES.glob("*.toml")), key=lambda name: (name != IDEAL, name)))


@cache
def load_profile(name: str = IDEAL) -> Profile:
    """Read a profile by its name, or by the path of a .toml. Raises ConfigurationError with one line."""
    if name.endswith(".toml"):
        return load_toml(Path(name), Profile)
    if name not in profile_names():
        raise ConfigurationError(
            f"unknown profile {name!r}; there is {', '.join(profile_names())}, or the path of a .toml"
        )
    return load_toml(_PROFILES / f"{name}.toml", Profile)
