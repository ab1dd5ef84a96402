"""Whether a recording's joints mean the places that the cell's file says: bases and pads by the file that is attached
to it, beside those of the present one, and beside what both pads held."""

import tomllib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hal.arrays import Array
from hal.configuration import ConfigurationError, from_document
from rtstack.control.tick import ArmController
from rtstack.log.reader import Log
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription

# ours: as much as the geometry of real arms may be off (rtstack.cells.metal); what a calibration corrects by less is
# no other place
MOVED_M = 3e-3
# ours: both pads so far off, and 4 mm by which pads and object give way, as the most yielding object of our cell does
GRIP_OFF_M = 0.01
_LOOKS = 20  # along the recording
_FEWEST_HELD = 50  # ticks


def described_in(log: Log) -> CellDescription | None:
    """Return the cell by the file that is attached to a log; None where it has none, or one of another version."""
    attached = next((each.data for each in log.attachments if each.name == "cell.toml"), None)
    try:
        return from_document(tomllib.loads((attached or b"").decode()), CellDescription, str(log.path))
    except (ConfigurationError, ValueError):
        return None


def grip_off_m(then: CellDescription | None, object_name: str, points: NDArray, held: NDArray[np.intp]) -> float:
    """Return by how much both pads' faces were further apart than what they held is wide, m; 0 where that is not known.

    It shows how both arms stand to each other, along the line between the pads, whatever a calibration says. points
    (2, n) of POINT; held: of them, where both pads felt it.
    """
    thing = None if then is None else then.objects.get(object_name)
    if thing is None or len(held) < _FEWEST_HELD:
        return 0.0
    out = points["rotation"][:, held][..., 2]  # of the faces
    along = out[0] - out[1]
    along /= np.linalg.norm(along, axis=1)[:, None]
    gap = np.median(((points["position"][1, held] - points["position"][0, held]) * along).sum(axis=1))
    return float(min((gap - width for width in thing.size), key=abs))


def moved_m(then: CellDescription | None, arms: tuple[ArmController, ArmController], q: Array) -> float:
    """Return by how much the pads come out elsewhere than when the log was made, m, at most; 0 where it has no file.

    q (2, n, 7): the recorded joints, rad.
    """
    if then is None:
        return 0.0
    looks = np.linspace(0, q.shape[1] - 1, _LOOKS).astype(int)
    away = 0.0
    for arm, mounting, own in zip(arms, (then.left, then.right), q[:, looks], strict=True):
        before = ArmModel(replace(mounting, model=arm.model.robot.reference), then.pad)
        for row in own:
            away = max(away, float(np.linalg.norm(_face(arm.model, row) - _face(before, row))))
    return away


def _face(model: ArmModel, q: Array) -> Array:
    model.update(np.ascontiguousarray(q), np.zeros(7))
    return model.p7 + model.R7 @ model.face
