"""The scene: where the arms, the table and the objects are, read from a TOML file and checked."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, degrees, hypot, pi, radians, sin
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Seven
from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Positive, load_toml
from hal.displacement import Displacement
from hal.errors import ObjectOutOfReach, UnknownObject
from hal.pad import Pad
from hal.robots import DEFAULT, RobotModel, robot
from sim_robot.hand_parameters import FrankaHand
from sim_robot.plant_parameters import OWN_FILES, Vector3, Vector3Positive

SIDES = ("left", "right")
NO_OBJECT = "none"  # in an object's place: an empty cell
_ROOM = {"pads": "between the pads", "pad": "before the pad"}
FURTHEST_YAW_DEG = 45.0  # beyond it the pads meet other faces

Vector2 = tuple[float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class ArmPlacement:
    """One arm: its base in the world (m, quaternion wxyz) and its start position (7 joints, rad).

    hand: on the flange instead of the pad; pad: where it is not the scene's. model: of the robot, a name or a TOML's
    path (hal.robots).
    """

    T_world_base_position: Vector3
    T_world_base_wxyz: Quaternion
    home: Seven
    hand: FrankaHand | None = None
    pad: Pad | None = None
    model: str = DEFAULT

    @property
    def robot(self) -> RobotModel:
        """The model of this arm."""
        return robot(self.model)

    def __post_init__(self) -> None:
        limits = self.robot.limits
        if not np.all((limits.q_lower < self.home) & (self.home < limits.q_upper)):
            raise ValueError(f"home must be inside the position limits of the model {self.model!r}")
        w, x, y, z = self.T_world_base_wxyz
        if abs((norm := hypot(w, x, y, z)) - 1.0) > 1e-2:  # as a cell's file: four rounded digits
            raise ValueError("T_world_base_wxyz must be a unit quaternion")
        object.__setattr__(self, "T_world_base_wxyz", (w / norm, x / norm, y / norm, z / norm))


@dataclass(frozen=True, slots=True)
class Table:
    """A box from the floor to top_z, m. stiffness in N/m."""

    centre_xy: Vector2
    size_xy: tuple[Positive, Positive]
    top_z: Positive
    stiffness: Positive
    friction: Positive


@checked(frozen=True, slots=True, config=STRICT, kw_only=True)
class ScenePad(Pad):
    """The silicone pad on each flange. stiffness of its silicone N/m."""

    size: Vector3Positive
    mass: Positive
    flange_to_face: Positive
    stiffness: Positive
    friction: Positive


@dataclass(frozen=True, slots=True)
class Platform:
    """A plate that is held in space, its upper surface at `centre` m, inclined about the world's y.

    Positive: its far edge, towards x, is the higher one. stiffness N/m and damping Ns/m of a pad's whole face on it.
    """

    centre: Vector3
    size: Vector3Positive
    inclination_deg: Annotated[float, Field(ge=-45.0, le=45.0)]
    stiffness: Positive
    damping: NotNegative


@dataclass(frozen=True, slots=True)
class ContactModel:
    """MuJoCo's constraint impedance d, and its ratio of frictional to normal impedance."""

    impedance: Annotated[float, Field(ge=1e-4, le=0.9999)]
    friction_ratio: Positive


@dataclass(frozen=True, slots=True)
class PlacementScatter:
    """Standard deviations of where the object stands."""

    position_mm: NotNegative
    yaw_deg: NotNegative


@dataclass(frozen=True, slots=True)
class GraspObject:
    """A box: mass kg, size m, its wall's stiffness N/m and damping ratio; frictions of pad and table, if not the
    scene's.
    """

    mass: Positive
    size: Vector3Positive
    stiffness: Positive
    damping_ratio: Positive
    pad_friction: Positive | None = None
    table_friction: Positive | None = None

    def footprint(self, yaw_rad: float) -> Vector2:
        """Half of its extent along the world's x and y, m, where it is turned about z."""
        c, s = abs(cos(yaw_rad)), abs(sin(yaw_rad))
        x, y = self.size[0] / 2.0, self.size[1] / 2.0
        return c * x + s * y, s * x + c * y


@dataclass(frozen=True, slots=True)
class ObjectPlacement:
    """Where the object starts: centre in the world (3,) m, quaternion wxyz (4,); on_wedge: tilted, on a wedge."""

    position: Vector3
    wxyz: Quaternion
    on_wedge: bool = False


@dataclass(frozen=True, slots=True)
class Scene:
    """The whole cell. Object 'sizes', positions and poses are in the world's frame.

    left, right: None where the cell has no such arm; it has one at least. platform: what the pads meet instead of an
    object, in scenes that have one.
    """

    name: str
    object_position_xy: Vector2
    pad_clearance: float
    table: Table
    pad: ScenePad
    contact: ContactModel
    placement_scatter: PlacementScatter
    objects: dict[str, GraspObject]
    left: ArmPlacement | None = None
    right: ArmPlacement | None = None
    platform: Platform | None = None

    def __post_init__(self) -> None:
        if not self.sides:
            raise ValueError("there is no arm: add [left], [right] or both")
        if not self.objects:
            raise ValueError("objects must not be empty")
        if NO_OBJECT in self.objects:
            raise ValueError(f"objects.{NO_OBJECT}: the name stands for an empty cell; choose another one")

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of the arms that there are, left before right. Arrays of all arms are in this order."""
        return tuple(side for side in SIDES if getattr(self, side) is not None)

    @property
    def arms(self) -> tuple[ArmPlacement, ...]:
        """The arms that there are, in the order of `sides`."""
        return tuple(getattr(self, side) for side in self.sides)

    @property
    def pads(self) -> tuple[Pad, ...]:
        """What is on each arm's flange, where no hand is."""
        return tuple(arm.pad or self.pad for arm in self.arms)

    def only(self, sides: Sequence[str]) -> "Scene":
        """Return the scene with these arms alone. Raises ConfigurationError for an arm that it has not."""
        for side in sides:
            if side not in self.sides:
                raise ConfigurationError(f"the cell has no {side} arm, only {' and '.join(self.sides)}")
        return replace(self, **{side: None for side in self.sides if side not in sides})

    def find(self, object_name: str) -> GraspObject:
        """Return the object of this name. Raises UnknownObject."""
        if object_name not in self.objects:
            known = ", ".join(sorted(self.objects))
            raise UnknownObject(
                f"unknown object '{object_name}'; this cell has: {known}; {NO_OBJECT}: an empty cell. "
                f"Define another one as [objects.{object_name}] in a cell's file, and give it with --cell-file"
            )
        return self.objects[object_name]

    def frictions(self, object_name: str) -> Vector2:
        """Return the coefficients of a pad and of the table on this object."""
        thing = self.find(object_name)
        pad = self.pad.friction if thing.pad_friction is None else thing.pad_friction
        return pad, self.table.friction if thing.table_friction is None else thing.table_friction

    def x_range(self, object_name: str, yaw_rad: float = 0.0) -> Vector2:
        """Return the smallest and largest displacement along x, m: on the table, the pads' middle on the faces."""
        thing = self.find(object_name)
        half, face = thing.footprint(yaw_rad)[0], cos(yaw_rad) * thing.size[0] / 2.0
        middle, table_half = self.table.centre_xy[0] - self.object_position_xy[0], self.table.size_xy[0] / 2.0
        return max(middle - table_half + half, -face), min(middle + table_half - half, face)

    def displacement_range(self, object_name: str, pad_faces_y: Vector2, yaw_rad: float = 0.0) -> Vector2:
        """Return the smallest and largest displacement along y, m, for pads at y (left, right); infinity: the table's
        edge.
        """
        half = self.find(object_name).footprint(yaw_rad)[1]
        y0, table_half = self.object_position_xy[1], self.table.size_xy[1] / 2.0
        left, right = pad_faces_y
        upper = min(left - self.pad_clearance, self.table.centre_xy[1] + table_half) - half - y0
        lower = max(right + self.pad_clearance, self.table.centre_xy[1] - table_half) + half - y0
        return lower, upper

    def place(
        self, object_name: str, displacement: Displacement | float, pad_faces_y: Vector2,
        generator: np.random.Generator | None, tilt_deg: float = 0.0,
    ) -> ObjectPlacement:  # fmt: skip
        """Put the object on the table (a number: along y, m), scattered by the generator, tilted about the world's x on
        a wedge.

        Raises UnknownObject, and ObjectOutOfReach with the allowed range.
        """
        thing = self.find(object_name)
        displacement = Displacement.of(displacement)
        yaw = displacement.yaw_rad
        if not abs(yaw) <= radians(FURTHEST_YAW_DEG):
            raise ObjectOutOfReach(
                f"{object_name} cannot be turned by {degrees(yaw):+.0f} deg: allowed are {-FURTHEST_YAW_DEG:+.0f} to "
                f"{FURTHEST_YAW_DEG:+.0f} deg (beyond, the pads meet other faces)"
            )
        pads = "pads" if len(self.arms) > 1 else "pad"
        ranges = (self.x_range(object_name, yaw), self.displacement_range(object_name, pad_faces_y, yaw))
        for axis, metres, (lower, upper) in zip("xy", (displacement.x_m, displacement.y_m), ranges, strict=True):
            if lower > upper:
                raise ObjectOutOfReach(
                    f"{object_name} is too long along {axis} for the table, or to stand {_ROOM[pads]}"
                )
            if not lower <= metres <= upper:
                raise ObjectOutOfReach(
                    f"{object_name} cannot stand {1e3 * metres:+.0f} mm from its place along {axis}: "
                    f"allowed are {1e3 * lower:+.0f} to {1e3 * upper:+.0f} mm (table edge and {pads})"
                )
        width = 2.0 * thing.footprint(yaw)[1]
        x, y = self.object_position_xy
        x += displacement.x_m
        if generator is not None:
            scatter = 1e-3 * self.placement_scatter.position_mm * generator.standard_normal(2)
            x, y = x + float(scatter[0]), y + float(scatter[1])
            yaw += self.placement_scatter.yaw_deg * pi / 180.0 * float(generator.standard_normal())
        z = self.table.top_z + thing.size[2] / 2.0
        w, s = cos(yaw / 2.0), sin(yaw / 2.0)
        if tilt_deg == 0.0:
            return ObjectPlacement((x, y + displacement.y_m, z), (w, 0.0, 0.0, s))
        tilt = tilt_deg * pi / 180.0
        z = self.table.top_z + (thing.size[2] * cos(tilt) + width * abs(sin(tilt))) / 2.0
        c, t = cos(tilt / 2.0), sin(tilt / 2.0)
        # first the yaw, then the tilt about the world's x
        return ObjectPlacement((x, y + displacement.y_m, z), (c * w, t * w, -t * s, c * s), on_wedge=True)


def load_scene(path: Path | None = None) -> Scene:
    """Read a scene, the grabbing cell by default. Raises ConfigurationError, naming the key."""
    return load_toml(path or OWN_FILES / "scenes" / "grab.toml", Scene)
