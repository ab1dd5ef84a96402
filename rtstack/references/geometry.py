"""Whether a recording's joints still mean the places that they meant when it was made: bases and pads by its cell's
file, which is attached to it, beside those of the present one."""

import tomllib
from dataclasses import replace

import numpy as np

from hal.arrays import Array
from hal.configuration import ConfigurationError, from_document
from rtstack.control.tick import ArmController
from rtstack.log.reader import Log
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription

# ours: as much as the geometry of real arms may be off (rtstack.cells.metal); what a calibration corrects by less is
# no other place
MOVED_M = 3e-3
_LOOKS = 20  # along the recording


def moved_m(log: Log, arms: tuple[ArmController, ArmController], q: Array) -> float:
    """Return by how much the pads come out elsewhere than when the log was made, m, at most; 0 where it has no file.

    q (2, n, 7): the recorded joints, rad.
    """
    attached = next((each.data for each in log.attachments if each.name == "cell.toml"), None)
    try:
        then = from_document(tomllib.loads((attached or b"").decode()), CellDescription, str(log.path))
    except (ConfigurationError, ValueError):  # none, or one of another version
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
