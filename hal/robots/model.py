"""What is known of a model of robot: one record that simulation, safety, control, planning and viewers take it from.

It is read from a TOML and a URDF, strictly: each key is expected and of its type, each number has a source.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Array
from hal.base.configuration import (
    ConfigurationError,
    NotNegative,
    Positive,
    Real,
    from_document,
    one_line,
    place_of,
    read_file,
    read_toml,
)
from hal.limits import CONTROL_RATE_HZ, DOF, ArmLimits
from hal.robots.bodies import TURN_RAD, DescriptionError
from hal.robots.description import described

_STRICT = ConfigDict(extra="forbid")
Seven = tuple[Real, Real, Real, Real, Real, Real, Real]
SevenPositive = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
SevenNotNegative = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
Motion = tuple[Positive, Positive, Positive]
_OF_JOINTS = ("q_lower", "q_upper", "dq_max", "ddq_max", "dddq_max", "tau_max")  # limits with a number a joint
Names = tuple[str, str, str, str, str, str, str]
# Of numbers that another unit (degrees, mm, g) would make larger; ours: no arm that shares a room with people has them
_MOST = {
    "limits.q_lower": (TURN_RAD, "rad"), "limits.q_upper": (TURN_RAD, "rad"), "limits.dq_max": (30.0, "rad/s"),
    "limits.ddq_max": (1e3, "rad/s^2"), "limits.dddq_max": (1e5, "rad/s^3"), "limits.tau_max": (1e3, "Nm"),
    "limits.tau_rate_max": (1e5, "Nm/s"), "limits.velocity_law.offset": (30.0, "rad/s"),
    "limits.velocity_law.deceleration": (1e3, "rad/s^2"), "cartesian.translation": ((30.0, 1e3, 1e5), "m, s"),
    "cartesian.rotation": ((30.0, 1e3, 1e5), "rad, s"), "cartesian.elbow": ((30.0, 1e3, 1e5), "rad, s"),
    "motor_inertia.B": (20.0, "kg m^2"), "motor_inertia.B_theta": (20.0, "kg m^2"), "friction.p1": (100.0, "Nm"),
    "friction.p2": (1e4, "s/rad"), "friction.p3": (30.0, "rad/s"),
}  # fmt: skip
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
    urdf: kinematics, inertias and collision capsules; whatever its source names them, the links are link0 (base) to
    link7 and link8 (flange), the joints joint1 to joint7 and joint8 (fixed), and the limits are those of `limits`.
    B, B_theta: the motors' inertia at the joints, bare and as the torque loop reduces it, kg m^2. friction: p1 Nm, p2
    s/rad, p3 rad/s of the sigmoid p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), which a controller counts on.
    sources: where the numbers come from, by the key of the TOML. plant: what the simulated arm has instead of the
    simulated robot's own numbers (sim_robot/parameters/plant.toml); nothing that controls or plans looks at it.
    meshes: for drawing, a folder of the package example-robot-data that has visual/linkN.dae and collision/linkN.stl;
    empty: the capsules are drawn.
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

    offset: SevenPositive
    deceleration: SevenPositive
    enforced: bool


@checked(frozen=True, slots=True, config=_STRICT)
class _Limits:
    q_lower: Seven
    q_upper: Seven
    dq_max: SevenPositive
    ddq_max: SevenPositive
    dddq_max: SevenPositive
    tau_max: SevenPositive
    tau_rate_max: Positive
    velocity_law: _VelocityLaw


@checked(frozen=True, slots=True, config=_STRICT)
class _Inertia:
    B: SevenPositive
    B_theta: SevenPositive


@checked(frozen=True, slots=True, config=_STRICT)
class _Friction:
    p1: SevenNotNegative
    p2: SevenNotNegative
    p3: Seven


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
        document, text = read_toml(path)
        file = from_document(document, _File, str(path), text)
    except ConfigurationError as error:
        raise RobotError(str(error)) from None
    if file.rate_hz != CONTROL_RATE_HZ:
        raise RobotError(f"{path}: key rate_hz: {file.rate_hz:g}; this stack controls at {CONTROL_RATE_HZ} Hz")
    for joint, (lower, upper) in enumerate(zip(file.limits.q_lower, file.limits.q_upper, strict=True), 1):
        if not lower < upper:
            raise RobotError(f"{path}: key limits.q_lower: joint {joint}: {lower:g} is not below {upper:g}")
    for key, (most, unit) in _MOST.items():
        value: Any = document
        for name in key.split("."):
            value = value[name]
        if np.any(np.abs(value) > most):
            place = place_of(str(path), text, key.split("."))
            raise RobotError(f"{place}: key {key}: {value}, expected at most {most} ({unit}): was another unit meant?")
    if without := _without_source(document, file.sources):
        raise RobotError(f"{path}: key sources: no entry says where {without} comes from")
    law = file.limits.velocity_law
    limits = ArmLimits(
        **{name: _fixed(getattr(file.limits, name)) for name in _OF_JOINTS},
        velocity_offset=_fixed(law.offset),
        deceleration=_fixed(law.deceleration),
        tau_rate_max=file.limits.tau_rate_max,
        velocity_law_enforced=law.enforced,
    )
    source = path.parent / file.urdf
    try:
        urdf = described(read_file(source), path.stem, file.joints, file.flange, limits)
    except DescriptionError as error:
        raise RobotError(one_line(f"{path}: key urdf: {source}: {error}")) from None
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RobotError(one_line(f"{path}: key urdf: {source} cannot be read: {reason}")) from None
    return RobotModel(
        reference=str(path.resolve()),
        title=file.title,
        urdf=urdf,
        limits=limits,
        cartesian=file.cartesian,
        B=_fixed(file.motor_inertia.B),
        B_theta=_fixed(file.motor_inertia.B_theta),
        friction=(_fixed(file.friction.p1), _fixed(file.friction.p2), _fixed(file.friction.p3)),
        sources=file.sources,
        plant={str(key): values for key, values in file.plant.items()},
        meshes=file.meshes,
    )


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
