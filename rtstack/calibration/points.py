"""The file of measured points, and what they are for the fit: `[points.NAME]` each.

what    touch: a pad's face is at `place` in the world; meet: both pads' faces are at one place, its own unknown;
        see: the tracker sees the marker of the flange at `place` in its own frame; rest: both arms rest, free, with
        `tau_left` and `tau_right`, Nm, as external torques
side    left or right: whose pad or marker
q_left, q_right    joints as measured, rad; missing: still to be measured
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
from rtstack.calibration.fit import Geometry, Observation
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.samples import SIDES

Joints = Annotated[tuple[Real, ...], Field(min_length=7, max_length=7)]


@checked(frozen=True, slots=True, config=STRICT)
class Point:
    """A point of the file: see above. place m."""

    what: Literal["touch", "meet", "see", "rest"] = "touch"
    side: Literal["left", "right"] = "left"
    place: tuple[Real, Real, Real] | None = None
    q_left: Joints | None = None
    q_right: Joints | None = None
    tau_left: Joints | None = None
    tau_right: Joints | None = None

    def __post_init__(self) -> None:
        """Check it."""
        if self.what in ("touch", "see") and self.place is None:
            raise ValueError(f"a point to {self.what} needs its place")

    @property
    def measured(self) -> bool:
        """Whether nothing of it is missing."""
        resting = self.tau_left is not None and self.tau_right is not None
        return self.q_left is not None and self.q_right is not None and (self.what != "rest" or resting)

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
    """Return the measured points as the fit takes them, without those at rest."""
    mountings = (description.left, description.right)
    found = []
    for name, point in points.items():
        if point.what == "rest" or point.q_left is None or point.q_right is None:
            continue
        q = (point.q_left, point.q_right)
        flanges = np.array([flange_pose(arm.robot, np.array(row)) for arm, row in zip(mountings, q, strict=True)])
        place = np.array(point.place or (0.0, 0.0, 0.0))
        found.append(Observation(name, point.what, SIDES.index(point.side), flanges, place))
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
