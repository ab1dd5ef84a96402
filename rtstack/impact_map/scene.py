"""The scene of an impact at its instant: arms, free objects, supports, and who touches whom.

World frame, SI units, orientations as quaternions wxyz. A scene is written in Python, or read from a TOML file whose
tables have the names of these classes' fields (deploy/impacts has examples).
"""

from dataclasses import field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Array
from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Positive, Real, load_toml
from hal.limits import DOF
from hal.pad import DEFAULT_PAD, Pad
from hal.robots import DEFAULT, FR3, RobotModel


class ReflectedInertia(StrEnum):
    """Which inertia of the motors, as it is felt at the joints, (10) adds to the links' mass matrix.

    B_theta: reduced by the low-level torque loop, the paper's choice; B: of the bare motors; none: links only.
    """

    B_THETA = "B_theta"
    B = "B"
    NONE = "none"


def joint_inertia(kind: ReflectedInertia, robot: RobotModel = FR3) -> Array:
    """Return what is added to the diagonal of an arm's mass matrix, (7,) kg m^2. Do not write to it."""
    return np.zeros(DOF) if kind is ReflectedInertia.NONE else getattr(robot, kind.value)


Vector = tuple[Real, Real, Real]
Quaternion = tuple[Real, Real, Real, Real]
Joints = tuple[Real, Real, Real, Real, Real, Real, Real]

UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
STILL: Vector = (0.0, 0.0, 0.0)


@checked(frozen=True, slots=True, config=STRICT)
class Arm:
    """An arm on its base, with the scene's pad: configuration rad, and before the impact either joint velocities rad/s
    or the twist of the pad's face (linear m/s, then angular rad/s, along the world's axes), which takes the joint
    velocities of least norm. Neither: the arm is still. model: of the robot (hal.robots). pad: its own, where it is not
    the scene's."""

    base_position: Vector
    q: Joints
    base_orientation_wxyz: Quaternion = UPRIGHT
    dq: Joints | None = None
    pad_twist: tuple[Real, Real, Real, Real, Real, Real] | None = None
    model: str = DEFAULT
    pad: Pad | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Box:
    """A free box: its centre, which is its centre of mass, m; velocity of the centre before the impact m/s, rad/s.

    inertia: principal moments along the box's axes, kg m^2; by default those of a solid box.
    """

    mass: Positive
    size: tuple[Positive, Positive, Positive]
    position: Vector
    orientation_wxyz: Quaternion = UPRIGHT
    inertia: tuple[Positive, Positive, Positive] | None = None
    velocity: Vector = STILL
    angular_velocity: Vector = STILL


@checked(frozen=True, slots=True, config=STRICT)
class Plane:
    """A support that nothing moves: a table, a floor, a wall. A point of its surface, m, and its outward normal. It may
    have a velocity of its own, m/s, that no impact changes (a conveyor, a press)."""

    point: Vector
    normal: Vector
    velocity: Vector = STILL


@checked(frozen=True, slots=True, config=STRICT)
class Contact:
    """A patch between two bodies: the first is an arm or a box, the second a box or a support.

    Without points, the contact is where the first body's face (an arm's pad) and the second's overlap, at the corners
    of that area. points: corner points, m, and normal, from the second body to the first, for other shapes. maintained:
    whether the patch is pressed together, and closed when the sequence of impacts has ended; by default where an arm is
    the first body.
    """

    between: tuple[str, str]
    friction: NotNegative
    maintained: bool | None = None
    points: Annotated[tuple[Vector, ...], Field(min_length=1)] | None = None
    normal: Vector | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Scene:
    """Everything that an impact depends on. Bodies have names of their own, over all three tables."""

    contacts: Annotated[tuple[Contact, ...], Field(min_length=1)]
    arms: dict[str, Arm] = field(default_factory=dict)
    objects: dict[str, Box] = field(default_factory=dict)
    supports: dict[str, Plane] = field(default_factory=dict)
    pad: Pad = DEFAULT_PAD
    reflected: ReflectedInertia = ReflectedInertia.B_THETA


class SceneError(ConfigurationError):
    """A scene that is none: one line that names the key and says what is wrong."""


def check_scene(scene: Scene) -> None:
    """Raise SceneError where bodies have no orientation, or contacts name bodies that are not there."""
    tables: dict[str, Literal["arms", "objects", "supports"]] = {}
    for table in ("arms", "objects", "supports"):
        for name in getattr(scene, table):
            if name in tables:
                raise SceneError(f"key {table}.{name}: {tables[name]} has a body of that name already")
            tables[name] = table
    for name, arm in scene.arms.items():
        _require(any(arm.base_orientation_wxyz), f"arms.{name}.base_orientation_wxyz", "a quaternion of zeros")
        both = arm.dq is not None and arm.pad_twist is not None
        _require(not both, f"arms.{name}", "give dq or pad_twist, not both")
    for name, box in scene.objects.items():
        _require(any(box.orientation_wxyz), f"objects.{name}.orientation_wxyz", "a quaternion of zeros")
        if box.inertia is not None:
            a, b, c = sorted(box.inertia)
            _require(a + b >= c, f"objects.{name}.inertia", "no body has it: one moment is above the other two's sum")
    for name, plane in scene.supports.items():
        _require(any(plane.normal), f"supports.{name}.normal", "a direction of zeros")
    for k, contact in enumerate(scene.contacts):
        key = f"contacts.{k}"
        for name in contact.between:
            _require(name in tables, f"{key}.between", f"no body is called {name!r}; there are {', '.join(tables)}")
        first, second = (tables[name] for name in contact.between)
        _require(contact.between[0] != contact.between[1], f"{key}.between", "a body does not touch itself")
        _require(first != "supports" and second != "arms", f"{key}.between",
                 "the first body is an arm or an object, the second an object or a support")  # fmt: skip
        _require((contact.points is None) == (contact.normal is None), key, "points and normal come together")
        _require(contact.normal is None or any(contact.normal), f"{key}.normal", "a direction of zeros")


def load_scene(path: Path) -> Scene:
    """Read and check a scene file. Raises ConfigurationError with one line."""
    scene = load_toml(path, Scene)
    try:
        check_scene(scene)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    return scene


def _require(good: bool, key: str, problem: str) -> None:
    if not good:
        raise SceneError(f"key {key}: {problem}")
