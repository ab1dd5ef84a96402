"""What was found, into the cell's file: the keys that change, with its comments and everything else left as it is."""

import datetime
import os
from pathlib import Path
from typing import Any

import numpy as np

from hal.arrays import Array
from hal.configuration import ConfigurationError, with_values
from rtstack.calibration.fit import SIDES, Fit
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.model.rotation import quaternion_from_rotation

Values = dict[tuple[str, ...], Any]


def changes(fit: Fit, description: CellDescription, today: datetime.date) -> Values:
    """Return the keys of the cell's file and the values that the points give them."""
    values: Values = {}
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
