"""What was found, into the cell's file: the keys that change, with its comments and everything else left as it is."""

import datetime
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hal.arrays import Array
from hal.configuration import ConfigurationError, with_values
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import SIDES

if TYPE_CHECKING:
    from rtstack.calibration.fit import Fit
    from rtstack.calibration.payload import Payload

Values = dict[tuple[str, ...], Any]


def changes(fit: "Fit", loads: Mapping[str, "Payload"], description: CellDescription, today: datetime.date) -> Values:
    """Return the keys of the cell's file and the values that the points give them.

    A pad's face, mass and centre are those of real arms alone: a simulated one has what its cell's file says.
    """
    values: Values = {}
    if not description.simulated:
        values |= _pads(fit, loads, description)
    for side, name in enumerate(SIDES):
        if f"{name} base" in fit.groups:
            values |= _pose((name,), fit.geometry.bases[side], "base_")
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
        zip(SIDES, (description.left, description.right), description.pads, strict=True)
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
    beside = path.with_name(f".{path.name}.new")
    try:
        beside.write_text(with_values(path.read_text(encoding="utf-8"), values), encoding="utf-8")
        load_cell_description(beside)
        os.replace(beside, path)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        beside.unlink(missing_ok=True)
