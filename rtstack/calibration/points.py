"""The file of measured points, what they are for the fit, and the result on its way into the file of the cell.

docs/howto/calibration.md describes it, `[points.NAME]` each. q_left, q_right: joints as measured, rad; a point without
is still to be measured, but for `stand`. tau_left, tau_right: external torques at rest, Nm. What a set of points gives
for a cell is the same for the terminal and for the page.
"""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Array
from hal.base.configuration import STRICT, ConfigurationError, Real, load_toml, toml_text, with_values
from hal.base.files import replacing, write_whole
from rtstack.calibration.fit import CalibrationError, Geometry, Observation
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import CellDescription, base_poses, load_cell_description
from rtstack.model.rotation import quaternion_from_rotation, rotation_from_quaternion

if TYPE_CHECKING:
    from rtstack.calibration.fit import Fit
    from rtstack.calibration.payload import Payload
from dataclasses import dataclass

from rtstack.calibration.fit import Fit, calibrate
from rtstack.calibration.payload import Payload, payload
from rtstack.cells.metal import LARGEST_RMS_MM
from rtstack.model.arm_model import build_model
from rtstack.trials.errors import TrialError

_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # as hal.tracker.TrackerFrames
Joints = Annotated[tuple[Real, ...], Field(min_length=7, max_length=7)]
Values = dict[tuple[str, ...], Any]


def changes(fit: "Fit", loads: Mapping[str, "Payload"], description: CellDescription, today: datetime.date) -> Values:
    """Return the keys of the cell's file and the values that the points give them.

    A pad's face, mass and centre are those of real arms alone: a simulated one has what its cell's file says.
    """
    values: Values = {}
    if not description.simulated:
        values |= _pads(fit, loads, description)
    for name, base in zip(fit.geometry.sides, fit.geometry.bases, strict=True):
        if f"{name} base" in fit.groups:
            values |= _pose((name,), base, "base_")
    if "tracker" in fit.groups:
        values |= _pose(("tracker",), fit.geometry.tracker, "")
    valid = description.calibration.valid_days if description.calibration else 180
    return values | {
        ("calibration", "date"): today,
        ("calibration", "valid_days"): valid,
        ("calibration", "rms_mm"): round(1e3 * fit.rms_m, 2),
        ("calibration", "uncertainty_mm"): round(1e3 * fit.place_m, 2),
        ("calibration", "points"): len(fit.residuals),
    }


def _pads(fit: "Fit", loads: Mapping[str, "Payload"], description: CellDescription) -> Values:
    values: Values = {}
    for side, (name, mounting, pad) in enumerate(
        zip(description.sides, description.arms, description.pads, strict=True)
    ):
        found: dict[str, Any] = {}
        if f"{name} pad" in fit.groups:
            x, y, z = fit.geometry.faces[side].round(5).tolist()
            found |= {"flange_to_face": z, "offset_xy": [x, y]}
        if name in loads:
            found |= {"mass": round(loads[name].mass, 4), "centre": loads[name].centre.round(4).tolist()}
        known = {key: value for key, value in asdict(pad).items() if value is not None}
        if found:  # an arm that had the cell's pad so far gets one of its own
            values |= {(name, "pad", key): v for key, v in (found if mounting.pad else known | found).items()}
    return values


def _pose(table: tuple[str, ...], T: Array, prefix: str) -> Values:
    wxyz = np.zeros(4)
    quaternion_from_rotation(np.ascontiguousarray(T[:3, :3]), wxyz)
    return {
        (*table, f"{prefix}position"): T[:3, 3].round(5).tolist(),
        (*table, f"{prefix}orientation_wxyz"): wxyz.round(7).tolist(),
    }


def write(path: Path, values: Values) -> None:
    """Change the file, at once and as a whole. Raises ConfigurationError where it could not be read afterwards."""
    try:
        with replacing(path) as beside:
            beside.write_text(with_values(path.read_text(encoding="utf-8"), values), encoding="utf-8")
            load_cell_description(beside)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


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

    def q(self, side: str) -> Joints | None:
        """The joints of an arm, rad; None: not measured."""
        return self.q_left if side == "left" else self.q_right

    def tau(self, side: str) -> Joints | None:
        """The external torques of an arm, Nm; None: not measured."""
        return self.tau_left if side == "left" else self.tau_right

    def measured(self, sides: Sequence[str]) -> bool:
        """Whether nothing of it is missing on a cell with the arms of these sides."""
        asked = [] if self.what == "stand" else [self.q(side) for side in sides]
        return None not in (asked if self.what != "rest" else (*asked, *map(self.tau, sides)))

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

    def taken(self, q: Array, tau: Array, sides: Sequence[str]) -> "Point":
        """Return it as measured: q (arms, 7), rad, and external torques (arms, 7), Nm, of the arms of these sides."""
        values: dict[str, Any] = {f"q_{side}": tuple(row) for side, row in zip(sides, q.round(6).tolist(), strict=True)}
        if self.what == "rest":
            values |= {f"tau_{side}": tuple(row) for side, row in zip(sides, tau.round(4).tolist(), strict=True)}
        return replace(self, **values)


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
        write_whole(path, toml_text(asdict(Points(dict(points)))))
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def observations(points: Mapping[str, Point], description: CellDescription) -> list[Observation]:
    """Return the measured points of the arms as the fit takes them, without those at rest. Raises CalibrationError."""
    check_arms(points, description)
    found, arms = [], description.mountings
    for name, point in points.items():
        if point.what in ("rest", "stand") or not point.measured(description.sides):
            continue
        flanges = np.array([flange_pose(arm.robot, np.array(point.q(side))) for side, arm in arms.items()])
        place = np.array(point.place or (0.0, 0.0, 0.0))
        if point.what == "see":
            place = _upright(place, description)
        own = point.side if point.what != "meet" else description.sides[0]
        found.append(Observation(name, point.what, description.sides.index(own), flanges, place))
    return found


def check_arms(points: Mapping[str, Point], description: CellDescription) -> None:
    """Raise CalibrationError for a point of an arm that the cell does not have."""
    sides = description.sides
    for name, point in points.items():
        if point.what == "meet" and len(sides) == 1:
            raise CalibrationError(
                f"{name}: two pads cannot meet, {description.name} has one arm, {sides[0]}: remove the point"
            )
        if point.what in ("touch", "see") and point.side not in sides:
            raise CalibrationError(
                f"{name}: {description.name} has no {point.side} arm, it has one arm, {sides[0]}: remove the point"
            )


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


def resting(points: Mapping[str, Point], side: str) -> tuple[Array, Array]:
    """Return joints (n, 7), rad, and external torques (n, 7), Nm, of an arm in the points at rest."""
    own = [point for point in points.values() if point.what == "rest" and point.measured((side,))]
    q, tau = [point.q(side) for point in own], [point.tau(side) for point in own]
    return np.array(q, dtype=float).reshape(-1, 7), np.array(tau, dtype=float).reshape(-1, 7)


def nominal_geometry(description: CellDescription) -> Geometry:
    """Return where everything is by the cell's file. Markers: on the flanges."""
    tracker, frame = np.eye(4), description.tracker
    tracker[:3, :3] = rotation_from_quaternion(np.array(frame.orientation_wxyz))
    tracker[:3, 3] = frame.position
    faces = np.array([pad.F_T_face[:3, 3] for pad in description.pads])
    return Geometry(np.array(base_poses(description)), tracker, faces, np.zeros_like(faces), description.sides)


@dataclass(frozen=True, slots=True)
class Outcome:
    """values: of the cell's file, by the names of table and key. loads: by side, of those that have points at rest.
    pivots: by object, (n, 3) m: its frame in the body that the tracker follows, as often as it has stood."""

    fit: Fit
    loads: dict[str, Payload]
    pivots: dict[str, Array]
    values: Values

    @property
    def refusal(self) -> str | None:
        """Why this is not written: a start on it would be refused. None where it may be."""
        if 1e3 * max(self.fit.rms_m, self.fit.place_m) <= LARGEST_RMS_MM:
            return None
        return f"above {LARGEST_RMS_MM:g} mm, not used: measure more points, further apart"

    @property
    def lines(self) -> tuple[str, ...]:
        """What was found and how well, for a person."""
        fit, lines = self.fit, []
        low, high = (1e3 * edge for edge in fit.rms_interval_m)
        lines.append(
            f"rms {1e3 * fit.rms_m:.2f} mm (95 %: {low:.2f} to {high:.2f}); in 95 % of such calibrations no pad is off "
            f"there by more than {1e3 * fit.place_m:.2f} mm, no base by {np.degrees(fit.turn_rad):.2f} deg"
        )
        for name, face in zip(fit.geometry.sides, fit.geometry.faces, strict=True):
            if f"{name} pad" in fit.groups:
                x, y, z = (1e3 * face).tolist()
                lines.append(f"{name} pad: its face is at x {x:+.1f}, y {y:+.1f}, z {z:+.1f} mm of the flange")
        for name, load in self.loads.items():
            centre = ", ".join(f"{1e3 * c:+.0f}" for c in load.centre)
            lines.append(
                f"{name} payload: {load.mass:.3f} +- {load.mass_half:.3f} kg, centre {centre} mm of the flange "
                f"(+- {1e3 * load.centre_half.max():.0f}); {load.rms_nm:.2f} Nm are left"
            )
        for name, rows in self.pivots.items():
            x, y, z = (1e3 * rows.mean(axis=0)).tolist()
            apart = 1e3 * float(np.linalg.norm(rows - rows.mean(axis=0), axis=1).max())
            lines.append(
                f"{name}: at x {x:+.1f}, y {y:+.1f}, z {z:+.1f} mm of the body that the tracker follows; stood "
                f"{len(rows)} times, at most {apart:.1f} mm from their mean"
            )
        return tuple(lines)

    def document(self) -> dict[str, object]:
        """Return all of it as JSON has it."""
        fit = self.fit
        return {
            "values": {
                ".".join(key): value.isoformat() if isinstance(value, datetime.date) else value
                for key, value in self.values.items()
            },
            "residuals_mm": {name: 1e3 * away for name, away in fit.residuals.items()},
            "wrong_mm": {name: 1e3 * away for name, away in fit.wrong.items()},
            "rms_mm": 1e3 * fit.rms_m,
            "rms_interval_mm": [1e3 * edge for edge in fit.rms_interval_m],
            "uncertainty_mm": 1e3 * fit.place_m,
            "uncertainty_deg": float(np.degrees(fit.turn_rad)),
            "pads_mm": (1e3 * fit.geometry.faces).tolist(),
            "pivots_mm": {name: (1e3 * rows.mean(axis=0)).tolist() for name, rows in self.pivots.items()},
            "payloads": {
                name: {"mass": load.mass, "mass_half": load.mass_half, "centre": load.centre.tolist()}
                for name, load in self.loads.items()
            },
        }


def outcome(points: Mapping[str, Point], description: CellDescription, today: datetime.date) -> Outcome:
    """Fit what the measured points determine. Raises TrialError with one line."""
    try:
        fit = calibrate(observations(points, description), nominal_geometry(description))
        loads: dict[str, Payload] = {}
        for (side, mounting), pad in zip(description.mountings.items(), description.pads, strict=True):
            q, tau = resting(points, side)
            if len(q):
                loads[side] = payload(build_model(mounting, pad), (pad.mass, pad.F_x_centre), q, tau)
        stood = pivots(points, description, fit.geometry.tracker)
    except CalibrationError as error:
        raise TrialError(str(error)) from None
    values = changes(fit, loads, description, today)
    values |= {("tracker", "bodies", name, "position"): rows.mean(axis=0).round(5).tolist()
               for name, rows in stood.items()}  # fmt: skip
    return Outcome(fit, loads, stood, values)
