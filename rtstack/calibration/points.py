"""The file of measured points, and what they are for the fit: `[points.NAME]` each.

what    touch: a pad's face is at `place` in the world; meet: both pads' faces are at one place, its own unknown;
        see: the tracker sees the marker of the flange at `place` in its own frame; stand: `object` stands on the
        table at the world's origin, not turned, and the tracker sees the body that it follows at `place`, in its own
        frame; rest: both arms rest, free, with `tau_left` and `tau_right`, Nm, as external torques
side    left or right: whose pad or marker
q_left, q_right    joints as measured, rad; missing: still to be measured; stand needs none
"""

from collections.abc import Mapping
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.arrays import Array
from hal.configuration import STRICT, ConfigurationError, Real, load_toml, toml_text
from rtstack.calibration.fit import CalibrationError, Geometry, Observation
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.samples import SIDES

_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # as hal.tracker.TrackerFrames
Joints = Annotated[tuple[Real, ...], Field(min_length=7, max_length=7)]


@checked(frozen=True, slots=True, config=STRICT)
class Point:
    """A point of the file: see above. place m."""

    what: Literal["touch", "meet", "see", "stand", "rest"] = "touch"
    side: Literal["left", "right"] = "left"
    place: tuple[Real, Real, Real] | None = None
    q_left: Joints | None = None
    q_right: Joints | None = None
    tau_left: Joints | None = None
    tau_right: Joints | None = None
    object: str = ""

    def __post_init__(self) -> None:
        """Check it."""
        if self.what in ("touch", "see", "stand") and self.place is None:
            raise ValueError(f"a point to {self.what} needs its place")
        if (self.what == "stand") != bool(self.object):
            raise ValueError("a point to stand needs its object, and no other has one")

    @property
    def measured(self) -> bool:
        """Whether nothing of it is missing."""
        asked = (self.place,) if self.what == "stand" else (self.q_left, self.q_right)
        return None not in (asked if self.what != "rest" else (*asked, self.tau_left, self.tau_right))

    @property
    def asked(self) -> str:
        """What a person has to do for it."""
        x, y, z = self.place or (0.0, 0.0, 0.0)
        match self.what:
            case "touch":
                return f"touch x {x:.4f}, y {y:.4f}, z {z:.4f} m with the middle of the {self.side} pad's face"
            case "meet":
                return "let both pads' faces touch each other, middle on middle"
            case "see":
                return f"any posture in which the tracker sees the {self.side} flange"
            case "stand":
                return f"put the {self.object} in its place at the origin, where the tracker sees it"
            case _:
                return "any posture, the pads free; then take the hands off"

    def taken(self, q: Array, tau: Array) -> "Point":
        """Return it as measured: q (2, 7), rad, and external torques (2, 7), Nm, of both arms."""
        left, right = (tuple(row) for row in q.round(6).tolist())
        felt = [tuple(row) for row in tau.round(4).tolist()] if self.what == "rest" else [None, None]
        return replace(self, q_left=left, q_right=right, tau_left=felt[0], tau_right=felt[1])


@checked(frozen=True, slots=True, config=STRICT)
class Points:
    """The file."""

    points: Annotated[dict[str, Point], Field(min_length=1)] = field(default_factory=dict)


def load_points(path: Path) -> dict[str, Point]:
    """Read the file. Raises ConfigurationError with one line."""
    return load_toml(path, Points).points


def save_points(path: Path, points: Mapping[str, Point]) -> None:
    """Write the file anew. Raises ConfigurationError."""
    try:
        path.write_text(toml_text(asdict(Points(dict(points)))), encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def observations(points: Mapping[str, Point], description: CellDescription) -> list[Observation]:
    """Return the measured points of the arms as the fit takes them, without those at rest."""
    mountings = (description.left, description.right)
    found = []
    for name, point in points.items():
        if point.what in ("rest", "stand") or point.q_left is None or point.q_right is None:
            continue
        q = (point.q_left, point.q_right)
        flanges = np.array([flange_pose(arm.robot, np.array(row)) for arm, row in zip(mountings, q, strict=True)])
        place = np.array(point.place or (0.0, 0.0, 0.0))
        if point.what == "see":
            place = _upright(place, description)
        found.append(Observation(name, point.what, SIDES.index(point.side), flanges, place))
    return found


def _upright(places: Array, description: CellDescription) -> Array:
    """Return places (..., 3) that the tracker has said, with z up as [tracker] position and orientation_wxyz count."""
    return places @ _FROM_Y_UP.T if description.tracker.up == "y" else places


def pivots(points: Mapping[str, Point], description: CellDescription, tracker: Array) -> dict[str, Array]:
    """Return where each object that stood in its place is in the body that the tracker follows: (n, 3) m, a row for
    each time. tracker (4, 4): T_world_tracker. Raises CalibrationError."""
    found: dict[str, Array] = {}
    for name in dict.fromkeys(point.object for point in points.values() if point.what == "stand"):
        body, thing = description.tracker.bodies.get(name), description.objects.get(name)
        if body is None or thing is None:
            table = "objects" if thing is None else "tracker.bodies"
            raise CalibrationError(f"the cell's file has no [{table}.{name}], which a point says has stood")
        places = _upright(np.array([point.place for point in points.values() if point.object == name]), description)
        seen = places @ tracker[:3, :3].T + tracker[:3, 3]
        middle = np.array([0.0, 0.0, description.table.top_z + thing.size[2] / 2.0])
        found[name] = (middle - seen) @ rotation_from_quaternion(np.array(body.orientation_wxyz)).T
    return found


def resting(points: Mapping[str, Point], side: int) -> tuple[Array, Array]:
    """Return joints (n, 7), rad, and external torques (n, 7), Nm, of an arm in the points at rest."""
    own = [point for point in points.values() if point.what == "rest" and point.measured]
    q = [point.q_left if side == 0 else point.q_right for point in own]
    tau = [point.tau_left if side == 0 else point.tau_right for point in own]
    return np.array(q, dtype=float).reshape(-1, 7), np.array(tau, dtype=float).reshape(-1, 7)


def nominal_geometry(description: CellDescription) -> Geometry:
    """Return where everything is by the cell's file. Markers: on the flanges."""
    tracker, frame = np.eye(4), description.tracker
    tracker[:3, :3] = rotation_from_quaternion(np.array(frame.orientation_wxyz))
    tracker[:3, 3] = frame.position
    faces = np.array([pad.F_T_face[:3, 3] for pad in description.pads])
    return Geometry(np.array(base_poses(description)), tracker, faces, np.zeros((2, 3)))
