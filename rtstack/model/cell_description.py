"""What a lab knows about its cell: where the arms stand, what they carry, where a trial starts."""

import datetime
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base import configuration
from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Positive
from hal.pad import Pad, Quaternion, Vector
from hal.robots import DEFAULT, RobotModel, reference_in, robot
from rtstack.model.camera_description import CameraDescription
from rtstack.model.plausible import check_plausible
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.model.tracker_description import TrackerDescription
from rtstack.safety.body import Base, Tool
from rtstack.safety.limits import hardware_limits
from rtstack.samples import SIDES, LawInertia, Reaction

Friction = Annotated[float, Field(gt=0.0, le=2.0, allow_inf_nan=False)]
# at most twice the paper's, N/m and Nm/rad: an untested gain is not accepted for real arms
Stiffness = Annotated[float, Field(ge=0.0, le=4000.0, allow_inf_nan=False)]
TurningStiffness = Annotated[float, Field(ge=0.0, le=40.0, allow_inf_nan=False)]
Stiffnesses = tuple[Stiffness, Stiffness, Stiffness, TurningStiffness, TurningStiffness, TurningStiffness]
CameraName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,15}$")]


@checked(frozen=True, slots=True, config=STRICT)
class ArmMounting:
    """Where an arm stands and where it starts. Base position m, orientation as quaternion wxyz, home in rad.

    model: of the robot, a registered name or the path of its TOML (hal.robots), in a cell's file from its folder. desk:
    HOST or HOST:PORT of its Desk, or ""; serial: of its control box, as `rtstack desk status` says it, "" where it is
    not compared. pad: its own, where it is not the cell's.
    """

    address: Annotated[str, Field(pattern=r"^[^\s,:/]+$")]
    base_position: Vector
    base_orientation_wxyz: Quaternion
    home: tuple[float, float, float, float, float, float, float]
    model: str = DEFAULT
    desk: Annotated[str, Field(pattern=r"^([A-Za-z0-9.-]+(:\d{1,5})?)?$")] = ""
    serial: str = ""
    pad: Pad | None = None

    @property
    def robot(self) -> RobotModel:
        """The model of this arm. Raises RobotError."""
        return robot(self.model)

    @property
    def base(self) -> Base:
        """What the safety judge knows of it. Raises ValueError for what is no place."""
        return Base(self.base_position, self.base_orientation_wxyz, self.robot)


@checked(frozen=True, slots=True, config=STRICT)
class Table:
    """The table's top: centre and size along x and y, height of its surface. m."""

    centre_xy: tuple[float, float]
    size_xy: tuple[Positive, Positive]
    top_z: float


@checked(frozen=True, slots=True, config=STRICT)
class ObjectDescription:
    """An object as a person would measure it: mass kg, outer size m. It stands on the table at the world's origin.

    pad_friction, table_friction: where they are not the cell's. plant: what a simulated robot has instead
    (sim_robot.lab_objects); nothing that controls or plans looks at it. give: how far a pad goes in under a force, m/N,
    as a static squeeze shows; None: not measured, plans then count on a wall of wood.
    """

    mass: Positive
    size: tuple[Positive, Positive, Positive]
    pad_friction: Friction | None = None
    table_friction: Friction | None = None
    give: Annotated[float, Field(gt=0.0, le=1e-3, allow_inf_nan=False)] | None = None
    plant: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)


@checked(frozen=True, slots=True, config=STRICT)
class StartMotionLimits:
    """How the arms go to where a trial begins: no joint faster than this (rad/s, rad/s^2), none further than
    longest_rad; not at all where every joint is within tolerance_rad."""

    speed_rad_s: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)] = 0.4
    acceleration_rad_s2: Annotated[float, Field(gt=0.0, le=5.0, allow_inf_nan=False)] = 1.0
    longest_rad: Annotated[float, Field(gt=0.0, le=6.0, allow_inf_nan=False)] = 1.5
    tolerance_rad: Annotated[float, Field(ge=0.001, le=0.05, allow_inf_nan=False)] = 0.005


@checked(frozen=True, slots=True, config=STRICT)
class TorqueFilter:
    """A first-order low-pass of the commanded torque, Hz; 0 for none."""

    cutoff_hz: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 0.0


@checked(frozen=True, slots=True, config=STRICT)
class ContactFriction:
    """Coefficients of friction, as a dynamometer shows them: of a pad on an object, and of an object on the table."""

    pad: Friction = 0.9
    table: Friction = 0.4


@checked(frozen=True, slots=True, config=STRICT)
class Gains:
    """Gains of this cell in the place of the papers' (rtstack.control.parameters), which count where there is None.

    Stiffness along and about the world's axes, N/m and Nm/rad; posture 1/s^2. law_inertia: the law's mass matrix.
    """

    stiffness: Stiffnesses | None = None
    stiffness_teleoperation: Stiffnesses | None = None
    posture_gain: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] | None = None
    law_inertia: LawInertia = LawInertia.LINKS_AND_MOTORS


@checked(frozen=True, slots=True, config=STRICT)
class Calibration:
    """When the geometry of real arms was measured, and how long that holds (`rtstack calibrate`).

    rms_mm: of what was left at the points; uncertainty_mm: in 95 % of such calibrations no pad was further off at them;
    points: how many.
    """

    date: datetime.date
    valid_days: Annotated[int, Field(ge=1, le=3650)] = 180
    rms_mm: NotNegative | None = None
    uncertainty_mm: NotNegative | None = None
    points: int | None = None


class LoadPolicy(StrEnum):
    """What becomes of an object that is still held after a stop: rtstack.trials.move."""

    HOLD = "hold"
    LOWER = "lower"
    RELEASE = "release"


@checked(frozen=True, slots=True, config=STRICT)
class CellDescription:
    """A cell of one arm or two, as its TOML describes it (deploy/cells).

    left, right: None for an arm that is not there. safety: the limits that it tightens (rtstack.safety.limits).
    unexpected_impact: what a trial does about one that asks for nothing; by default it stops where the arms are real.
    enforce_realtime: real arms, not those on this machine, are refused on a kernel that is not real-time. calibration:
    needed for real arms (rtstack.cells.metal). contact_friction: what plans count on. joint_friction: the file that
    `rtstack identify-friction` wrote; in the TOML relative to its folder. By rtstack.cells.commissioning, refused:
    kinds of run that are not allowed, with the reasons; commissioning: what is capped and what is next. countdown_s:
    audible seconds before each motion of real arms.
    """

    name: str
    simulated: bool
    pad: Pad
    table: Table
    objects: Annotated[dict[str, ObjectDescription], Field(min_length=1)]
    left: ArmMounting | None = None
    right: ArmMounting | None = None
    tracker: TrackerDescription = field(default_factory=TrackerDescription)
    start_motion: StartMotionLimits = field(default_factory=StartMotionLimits)
    torque_filter: TorqueFilter = field(default_factory=TorqueFilter)
    contact_friction: ContactFriction = field(default_factory=ContactFriction)
    gains: Gains = field(default_factory=Gains)
    calibration: Calibration | None = None
    enforce_realtime: bool = True
    unexpected_impact: Reaction | None = None
    load_after_stop: LoadPolicy = LoadPolicy.HOLD
    safety: dict[str, Any] = field(default_factory=dict)
    joint_friction: Path | None = None
    refused: dict[str, str] = field(default_factory=dict)
    commissioning: str = ""
    countdown_s: Annotated[int, Field(ge=0, le=30)] = 0
    cameras: dict[CameraName, CameraDescription] = field(default_factory=dict)

    @property
    def reaction(self) -> Reaction:
        """What a trial does about an unexpected impact where it asks for nothing else."""
        return self.unexpected_impact or (Reaction.CONTINUE if self.simulated else Reaction.STOP)

    @property
    def mountings(self) -> dict[str, ArmMounting]:
        """The arms that are there by their side, left before right. All that is of each arm is in this order."""
        return {side: arm for side, arm in zip(SIDES, (self.left, self.right), strict=True) if arm is not None}

    @property
    def sides(self) -> tuple[str, ...]:
        return tuple(self.mountings)

    @property
    def arms(self) -> tuple[ArmMounting, ...]:
        return tuple(self.mountings.values())

    @property
    def robots(self) -> tuple[RobotModel, ...]:
        return tuple(arm.robot for arm in self.arms)

    @property
    def pads(self) -> tuple[Pad, ...]:
        return tuple(arm.pad or self.pad for arm in self.arms)

    @property
    def tools(self) -> tuple[Tool, ...]:
        """The same as the safety judge sees it. Raises ValueError for what is no pad."""
        return tuple(map(tool_of, self.pads))

    @property
    def bases(self) -> tuple[Base, ...]:
        """Where each arm stands, as the safety judge sees it. Raises ValueError for what is no place."""
        return tuple(arm.base for arm in self.arms)

    @property
    def home(self) -> NDArray[np.float64]:
        """The posture (arms, 7), rad, in which a recording begins."""
        return np.array([arm.home for arm in self.arms])

    def refusal(self, asked: Any) -> str:
        """Return why the cell refuses a run with this specification, "" where it does not. A shadow moves nothing."""
        return "" if getattr(asked, "shadow", False) else self.refused.get(asked.verb, "")

    def only(self, sides: Collection[str]) -> "CellDescription":
        """Return the description with the arms of these sides alone. Raises ValueError where one is not there."""
        for side in sides:
            if side not in self.mountings:
                raise ValueError(f"there is no [{side}] arm")
        return replace(self, **{side: arm if side in sides else None for side, arm in self.mountings.items()})

    def about(self, object_name: str) -> "CellDescription":
        """Return the description with the contact friction of this object, where it has its own."""
        thing = self.objects[object_name]
        own = {"pad": thing.pad_friction, "table": thing.table_friction}
        own = {what: friction for what, friction in own.items() if friction is not None}
        return replace(self, contact_friction=replace(self.contact_friction, **own))


def tool_of(pad: Pad) -> Tool:
    """Return a pad as the safety judge sees it. Raises ValueError."""
    return Tool(pad.size, pad.flange_to_face, pad.offset_xy, pad.orientation_wxyz)


@dataclass(frozen=True, slots=True)
class Frame:
    """A rigid transform: rotation (3, 3) and translation (3,), m."""

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


def base_frame(mounting: ArmMounting) -> Frame:
    """Return T_world_base of an arm."""
    rotation = rotation_from_quaternion(np.array(mounting.base_orientation_wxyz))
    return Frame(rotation=rotation, translation=np.array(mounting.base_position))


def base_poses(description: CellDescription) -> tuple[NDArray[np.float64], ...]:
    """Return T_world_base (4, 4) of each arm."""
    poses = np.tile(np.eye(4), (len(description.arms), 1, 1))
    for T, mounting in zip(poses, description.arms, strict=True):
        frame = base_frame(mounting)
        T[:3, :3], T[:3, 3] = frame.rotation, frame.translation
    return tuple(poses)


def load_cell_description(path: Path, homeless: bool = False) -> CellDescription:
    """Read and check a cell description. homeless: its arms' `home` may be missing, and is not checked. Raises
    ConfigurationError with one line that names the key."""
    document, text = configuration.read_toml(path)
    for side in SIDES if homeless else ():
        if isinstance(arm := document.get(side), dict):
            arm.setdefault("home", [0.0] * 7)
    try:
        description = configuration.from_document(document, CellDescription, str(path), text)
    except ConfigurationError as error:
        raise ConfigurationError(_advised(str(error), path)) from None
    if not description.mountings:
        raise ConfigurationError(f"{path}: a cell has one arm or two: [left], [right], or both")
    arms = {side: replace(arm, model=reference_in(path, arm.model)) for side, arm in description.mountings.items()}
    description, pad = replace(description, **arms), description.pad
    checks: list[tuple[str, Callable[[], object]]] = []
    for side, arm in arms.items():
        checks += [(f"{side}.model: ", partial(getattr, arm, "robot"))]
        checks += [] if homeless else [(f"{side}.home", partial(_check_home, arm))]
    checks.append(("right.address", lambda: _check_others([arm.address for arm in arms.values()])))
    for side, arm in arms.items():
        checks += [(f"{side}.serial", partial(_check_serial, arm)), (f"{side}.", partial(getattr, arm, "base"))]
    checks += [("objects.", lambda: _check_names(description.objects)), ("pad.", lambda: tool_of(pad))]
    checks += [(f"{side}.pad.", partial(tool_of, arm.pad or pad)) for side, arm in arms.items()]
    checks.append(("", lambda: [hardware_limits(model).tightened(description.safety) for model in description.robots]))
    checks.append(("", lambda: check_plausible(description, homeless)))
    for key, check in checks:
        try:
            check()
        except ValueError as error:
            words = f"{key}{error}"
            name = re.match(r"[\w.]+", words)
            wrong = name[0].split(".") if name else ()
            place = configuration.place_of(str(path), configuration.read_file(path), wrong)
            raise ConfigurationError(configuration.one_line(_advised(f"{place}: key {words}", path))) from None
    if description.joint_friction is not None:
        description = replace(description, joint_friction=path.resolve().parent / description.joint_friction)
    return description


def _advised(words: str, path: Path) -> str:
    """Return an error's words, with what finds a home where it is about one."""
    return f"{words}; `rtstack home {path}` finds one" if re.search(r"\bhome\b", words) else words


def _check_names(objects: Collection[str]) -> None:
    if "none" in objects:
        raise ValueError("none: the name stands for an empty cell; choose another one")


def _check_home(arm: ArmMounting) -> None:
    limits = arm.robot.limits
    for joint, (q, low, high) in enumerate(zip(arm.home, limits.q_lower, limits.q_upper, strict=True), 1):
        if not low < q < high:
            raise ValueError(f": joint {joint} at {q:g} rad is not between {low:g} and {high:g}")


def _check_serial(arm: ArmMounting) -> None:
    if arm.serial and not arm.desk:
        raise ValueError(f': {arm.serial} is compared with what Desk says: name its address, desk = "HOST"')


def _check_others(addresses: list[str]) -> None:
    if len(set(addresses)) < len(addresses):
        raise ValueError(f": {addresses[0]} is the left arm's too; two arms have two addresses")
