"""What a set of points gives for a cell: the same for the terminal and for the page."""

import datetime
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hal.base.arrays import Array
from rtstack.calibration.fit import CalibrationError, Fit, calibrate
from rtstack.calibration.payload import Payload, payload
from rtstack.calibration.points import Point, Values, changes, nominal_geometry, observations, pivots, resting
from rtstack.cells.metal import LARGEST_RMS_MM
from rtstack.model.arm_model import build_model
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError


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
