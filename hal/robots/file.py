"""A robot model from its TOML and URDF, strictly: each key is expected and of its type, each number has a source."""

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import ConfigurationError, Positive, Real, from_document, read_toml
from hal.limits import CONTROL_RATE_HZ, DOF, ArmLimits
from hal.robots.description import DescriptionError, described
from hal.robots.model import Array, CartesianLimits, RobotModel

_STRICT = ConfigDict(extra="forbid")
Seven = tuple[Real, Real, Real, Real, Real, Real, Real]
SevenPositive = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
Motion = tuple[Positive, Positive, Positive]
Names = tuple[str, str, str, str, str, str, str]


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
class _Cartesian:
    translation: Motion
    rotation: Motion
    elbow: Motion


@checked(frozen=True, slots=True, config=_STRICT)
class _Inertia:
    B: SevenPositive
    B_theta: SevenPositive


@checked(frozen=True, slots=True, config=_STRICT)
class _Friction:
    p1: Seven
    p2: Seven
    p3: Seven


@checked(frozen=True, slots=True, config=_STRICT)
class _File:
    title: str
    urdf: str
    joints: Names
    flange: str
    rate_hz: float
    limits: _Limits
    cartesian: _Cartesian
    motor_inertia: _Inertia
    friction: _Friction
    sources: dict[str, str]
    plant: dict[str, Any] = Field(default_factory=dict)
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
    if without := _without_source(document, file.sources):
        raise RobotError(f"{path}: key sources: no entry says where {without} comes from")
    limits = _arm_limits(file.limits)
    source = path.parent / file.urdf
    try:
        text = source.read_text(encoding="utf-8")
        urdf = described(text, path.stem, file.joints, file.flange, limits)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RobotError(f"{path}: key urdf: {source} cannot be read: {reason}") from None
    except DescriptionError as error:
        raise RobotError(f"{path}: key urdf: {source}: {error}") from None
    return RobotModel(
        reference=str(path.resolve()),
        title=file.title,
        urdf=urdf,
        limits=limits,
        cartesian=CartesianLimits(file.cartesian.translation, file.cartesian.rotation, file.cartesian.elbow),
        B=_fixed(file.motor_inertia.B),
        B_theta=_fixed(file.motor_inertia.B_theta),
        friction=(_fixed(file.friction.p1), _fixed(file.friction.p2), _fixed(file.friction.p3)),
        sources=file.sources,
        plant=file.plant,
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


def _arm_limits(limits: _Limits) -> ArmLimits:
    law = limits.velocity_law
    return ArmLimits(
        q_lower=_fixed(limits.q_lower),
        q_upper=_fixed(limits.q_upper),
        dq_max=_fixed(limits.dq_max),
        velocity_offset=_fixed(law.offset),
        deceleration=_fixed(law.deceleration),
        ddq_max=_fixed(limits.ddq_max),
        dddq_max=_fixed(limits.dddq_max),
        tau_max=_fixed(limits.tau_max),
        tau_rate_max=limits.tau_rate_max,
        velocity_law_enforced=law.enforced,
    )


def _fixed(values: tuple[float, ...]) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    assert array.shape == (DOF,)
    return array
