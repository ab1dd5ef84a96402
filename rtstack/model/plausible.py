"""Whether the numbers of a cell's file can be those of a cell: what another unit or another order makes of them.

The bounds are ours: such arms reach 0.9 m and carry 3 to 14 kg, so that nothing of a cell is much further or heavier.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from hal.pad import Pad
from rtstack.safety.body import arm_body
from rtstack.safety.guided import standing
from rtstack.safety.limits import hardware_limits

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription

_FAR_M, _LARGE_M, _HIGH_M, _PAD_M = 5.0, 1.0, 2.0, 0.5
_HEAVY_KG, _PAD_KG = 20.0, (0.01, 5.0)
_APART_M = 0.1
_BOX = ("ee_lower", "ee_upper")
_OUTSIDE_M = 0.1  # a calibration moves a base by some cm, another unit, order or side by more


def check_plausible(description: "CellDescription", homeless: bool = False) -> None:
    """Raise ValueError, beginning with the key, for the first number that can hardly be meant. homeless: the arms'
    `home` does not count."""
    for key, value, most in _lengths(description):
        if not np.abs(value).max() <= most:
            raise ValueError(f"{key}: {np.abs(value).max():g} m is more than {most:g} m: was it meant in mm?")
    for name, thing in description.objects.items():
        if (kg := thing.mass) > _HEAVY_KG:
            raise ValueError(f"objects.{name}.mass: {kg:g} kg is more than {_HEAVY_KG:g} kg: was it meant in g?")
    for key, pad in _pads(description):
        if not _PAD_KG[0] <= pad.mass <= _PAD_KG[1]:
            raise ValueError(f"{key}.mass: {pad.mass:g} kg is not between {_PAD_KG[0]:g} and {_PAD_KG[1]:g} kg")
    places = [arm.base_position for arm in description.arms]
    if len(places) == 2 and np.linalg.norm(np.array(places[0]) - np.array(places[1])) < _APART_M:
        raise ValueError("right.base_position: both bases are in one place")
    _check_reach(description)
    if not homeless:
        _check_home(description)


def _pads(description: "CellDescription") -> Iterator[tuple[str, Pad]]:
    yield "pad", description.pad
    yield from ((f"{side}.pad", arm.pad) for side, arm in description.mountings.items() if arm.pad is not None)


def _lengths(description: "CellDescription") -> Iterator[tuple[str, Any, float]]:
    for side, arm in description.mountings.items():
        yield f"{side}.base_position", arm.base_position, _FAR_M
    table = description.table
    yield from (("table.centre_xy", table.centre_xy, _FAR_M), ("table.size_xy", table.size_xy, _FAR_M))
    yield "table.top_z", table.top_z, _HIGH_M
    yield from ((f"safety.{key}", description.safety[key], _FAR_M) for key in _BOX if key in description.safety)
    yield from ((f"objects.{name}.size", thing.size, _LARGE_M) for name, thing in description.objects.items())
    tracker = description.tracker
    yield "tracker.position", tracker.position, _FAR_M
    yield from ((f"tracker.bodies.{name}.position", body.position, _FAR_M) for name, body in tracker.bodies.items())
    yield from ((f"cameras.{name}.position", camera.position, _FAR_M) for name, camera in description.cameras.items())
    for key, pad in _pads(description):
        yield f"{key}.offset_xy", pad.offset_xy, _PAD_M
        yield from ((f"{key}.size", pad.size, _PAD_M), (f"{key}.flange_to_face", pad.flange_to_face, _PAD_M))


def _check_reach(description: "CellDescription") -> None:
    """Refuse a table out of the arms' reach: of what lies stretched between the second joint and the pad's face."""
    for base, tool in zip(description.bases, description.tools, strict=True):
        body = arm_body(base, tool)
        lengths, along = body["translation"], body["base_rotation"] @ (0.0, 0.0, 1.0)
        shoulder = base.position[2] + along[2] * (lengths[0] + body["rotation"][0] @ lengths[1])[2]
        reach = np.linalg.norm([*lengths[2:], body["face"]], axis=1).sum()
        if abs(description.table.top_z - shoulder) > reach:
            raise ValueError(
                f"table.top_z: {description.table.top_z:g} m is out of the reach of an arm whose shoulder is at "
                f"{shoulder:.3g} m"
            )


def _check_home(description: "CellDescription") -> None:
    """Refuse bases whose pads, at home, are out of their box or in the table."""
    limits = tuple(hardware_limits(model).tightened(description.safety) for model in description.robots)
    faces = standing(description.home, description.bases, description.tools, limits).face
    table, half = description.table, np.array(description.table.size_xy) / 2
    for side, face, limit in zip(description.sides, faces, limits, strict=True):
        where = f"{side}.base_position: at home the {side} pad's face is at {np.round(face, 2).tolist()} m, "
        wrong = "a base (m; w, x, y, z), home, or the sides of both arms are wrong"
        beyond = np.maximum(np.subtract(limit.ee_lower, face), np.subtract(face, limit.ee_upper))
        if beyond.max() > _OUTSIDE_M:
            raise ValueError(f"{where}outside of its box ([safety] ee_lower, ee_upper): {wrong}")
        if np.all(np.abs(face[:2] - table.centre_xy) < half) and face[2] < table.top_z - _OUTSIDE_M:
            raise ValueError(f"{where}in the table: {wrong}")
