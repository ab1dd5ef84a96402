"""What is known of a model of robot: one record that simulation, safety, control, planning and viewers take it from.

It is read from a TOML and a URDF, strictly: each key is expected and of its type, each number has a source.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from hal.base import configuration
from hal.base.arrays import Array
from hal.base.configuration import ConfigurationError, NotNegative, Positive, Real
from hal.limits import CONTROL_RATE_HZ, DOF, ArmLimits
from hal.robots.bodies import TURN_RAD, DescriptionError
from hal.robots.description import described

_STRICT = ConfigDict(extra="forbid")


def _most(most: float | tuple[float, ...], unit: str) -> AfterValidator:
    """Refuse numbers that another unit (degrees, mm, g) makes larger than those of an arm beside people; ours."""

    def check(values: Any) -> Any:
        if np.any(np.abs(values) > most):
            raise ValueError(f"{values}, expected at most {most} ({unit}): was another unit meant?")
        return values

    return AfterValidator(check)


Seven = tuple[Real, Real, Real, Real, Real, Real, Real]
SevenPositive = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
SevenNotNegative = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
Motion = Annotated[tuple[Positive, Positive, Positive], _most((30.0, 1e3, 1e5), "m or rad, s")]
_OF_JOINTS = ("q_lower", "q_upper", "dq_max", "ddq_max", "dddq_max", "tau_max")  # limits with a number a joint
Names = tuple[str, str, str, str, str, str, str]
_OF_THE_PLANT = Literal["B", "B_theta", "K", "D", "friction_p1", "friction_p2", "friction_p3"]


@dataclass(frozen=True, slots=True)
class CartesianLimits:
    """Limits of the end effector's motion generators: velocity, acceleration and jerk; m, rad, and the elbow's rad."""

    translation: Motion
    rotation: Motion
    elbow: Motion


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """A torque-controlled arm of 7 joints at 1 kHz. Arrays have shape (7,), SI units, and are read-only.

    reference: how a cell's file names it, a registered name or the path of its TOML. title: its name for people.
    urdf: kinematics, inertias and collision capsules, with the links link0 (base) to link7 and link8 (flange), the
    joints joint1 to joint7 and joint8 (fixed), and the limits of `limits`. B, B_theta: the motors' inertia at the
    joints, bare and as the torque loop reduces it, kg m^2. friction: p1 Nm, p2 s/rad, p3 rad/s of the sigmoid
    p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), which a controller counts on. sources: by the key of the
    TOML. plant: of the simulated arm, instead of sim_robot/parameters/plant.toml; nothing that controls or plans looks
    at it. meshes: a folder of example-robot-data with visual/linkN.dae and collision/linkN.stl, or empty.
    """

    reference: str
    title: str
    urdf: str
    limits: ArmLimits
    cartesian: CartesianLimits
    B: Array
    B_theta: Array
    friction: tuple[Array, Array, Array]
    sources: Mapping[str, str]
    plant: Mapping[str, Any]
    meshes: str = ""

    @property
    def name(self) -> str:
        """The registered name, or that of the file."""
        return Path(self.reference).stem


class RobotError(ValueError):
    """A robot model that cannot be used. One line: the file and the key, or the name and those that there are."""


@checked(frozen=True, slots=True, config=_STRICT)
class _VelocityLaw:
    """How the velocity limit falls towards a position limit: ArmLimits. enforced: by the robot itself."""

    offset: Annotated[SevenPositive, _most(30.0, "rad/s")]
    deceleration: Annotated[SevenPositive, _most(1e3, "rad/s^2")]
    enforced: bool


@checked(frozen=True, slots=True, config=_STRICT)
class _Limits:
    q_lower: Annotated[Seven, _most(TURN_RAD, "rad")]
    q_upper: Annotated[Seven, _most(TURN_RAD, "rad")]
    dq_max: Annotated[SevenPositive, _most(30.0, "rad/s")]
    ddq_max: Annotated[SevenPositive, _most(1e3, "rad/s^2")]
    dddq_max: Annotated[SevenPositive, _most(1e5, "rad/s^3")]
    tau_max: Annotated[SevenPositive, _most(1e3, "Nm")]
    tau_rate_max: Annotated[Positive, _most(1e5, "Nm/s")]
    velocity_law: _VelocityLaw


@checked(frozen=True, slots=True, config=_STRICT)
class _Inertia:
    B: Annotated[SevenPositive, _most(20.0, "kg m^2")]
    B_theta: Annotated[SevenPositive, _most(20.0, "kg m^2")]


@checked(frozen=True, slots=True, config=_STRICT)
class _Friction:
    p1: Annotated[SevenNotNegative, _most(100.0, "Nm")]
    p2: Annotated[SevenNotNegative, _most(1e4, "s/rad")]
    p3: Annotated[Seven, _most(30.0, "rad/s")]


@checked(frozen=True, slots=True, config=_STRICT)
class _File:
    title: str
    urdf: str
    joints: Names
    flange: str
    rate_hz: float
    limits: _Limits
    cartesian: CartesianLimits
    motor_inertia: _Inertia
    friction: _Friction
    sources: dict[str, str]
    plant: dict[_OF_THE_PLANT, Seven] = Field(default_factory=dict)
    meshes: str = ""


def read_robot(path: Path) -> RobotModel:
    """Read a model's TOML and the URDF that it names, beside it. Raises RobotError with one line."""
    try:
        document, text = configuration.read_toml(path)
        file = configuration.from_document(document, _File, str(path), text)
    except ConfigurationError as error:
        raise RobotError(str(error)) from None
    if file.rate_hz != CONTROL_RATE_HZ:
        raise RobotError(f"{path}: key rate_hz: {file.rate_hz:g}; this stack controls at {CONTROL_RATE_HZ} Hz")
    for joint, (lower, upper) in enumerate(zip(file.limits.q_lower, file.limits.q_upper, strict=True), 1):
        if not lower < upper:
            raise RobotError(f"{path}: key limits.q_lower: joint {joint}: {lower:g} is not below {upper:g}")
    if without := _without_source(document, file.sources):
        raise RobotError(f"{path}: key sources: no entry says where {without} comes from")
    law = file.limits.velocity_law
    limits = ArmLimits(
        **{name: _fixed(getattr(file.limits, name)) for name in _OF_JOINTS}, tau_rate_max=file.limits.tau_rate_max,
        velocity_offset=_fixed(law.offset), deceleration=_fixed(law.deceleration), velocity_law_enforced=law.enforced,
    )  # fmt: skip
    source = path.parent / file.urdf
    try:
        urdf = described(configuration.read_file(source), path.stem, file.joints, file.flange, limits)
    except (OSError, ValueError, RecursionError) as error:
        cannot = "" if isinstance(error, DescriptionError) else " cannot be read"
        reason = error.strerror if isinstance(error, OSError) else error
        raise RobotError(configuration.one_line(f"{path}: key urdf: {source}{cannot}: {reason}")) from None
    return RobotModel(
        str(path.resolve()), file.title, urdf, limits, file.cartesian, _fixed(file.motor_inertia.B),
        _fixed(file.motor_inertia.B_theta),
        friction=(_fixed(file.friction.p1), _fixed(file.friction.p2), _fixed(file.friction.p3)),
        sources=file.sources, plant={str(key): values for key, values in file.plant.items()}, meshes=file.meshes,
    )  # fmt: skip


def _without_source(document: dict[str, Any], sources: dict[str, str]) -> str:
    """Return the first key of a number that has no source of its own or of a table that it is in; "" where all have."""
    tables = [("", {key: document[key] for key in ("urdf", "limits", "cartesian", "motor_inertia", "friction")})]
    while tables:
        prefix, table = tables.pop()
        for key, value in table.items():
            name = prefix + key
            if name in sources:
                continue
            if not isinstance(value, dict):
                return name
            tables.append((f"{name}.", value))
    return ""


def _fixed(values: tuple[float, ...]) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    assert array.shape == (DOF,)
    return array
