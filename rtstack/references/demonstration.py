"""A scripted operator: moves the two target frames the way a person would grab, lift, carry, put down and let go.

Variations are numbered. Each differs from the next in speed, path, height and timing; variation 0 is the plain one.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.control.records import POINT
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ObjectDescription, Table
from rtstack.references.quintic import ViaPoint, quintic_path

LEAST_RISE_M = 0.05  # room to gather the upward speed in
FLAT_RAD = 1e-5  # a face that is off by less is not turned: home has six digits


@dataclass(frozen=True, slots=True)
class Grab:
    """The numbers of one demonstration. Times s, lengths m, speeds m/s."""

    rest_s: float = 0.3
    approach_s: float = 1.0
    squeeze_s: float = 0.55
    lift_s: float = 1.2
    carry_s: float = 0.6
    lower_s: float = 1.1
    release_s: float = 0.6
    speed_y: float = 0.35  # at the surface, towards the object
    speed_z: float = 0.15  # at the surface, upwards: the arms grab while they rise
    steady_s: float = 0.2  # before the surface at constant velocity, as hands that have made up their mind
    squeeze: float = 0.12  # how far inside the object the targets go
    lift: float = 0.25
    carry_x: float = 0.05
    height: float = 0.02  # of the impact, above the object's centre
    retreat: float = 0.12
    lag_s: tuple[float, float] = (0.0, 0.0)  # no two hands are quite simultaneous


def grab(
    variation: int, speed_m_s: float | None = None, squeeze_m: float | None = None, squeeze_s: float | None = None
) -> Grab:
    """Return the demonstration of this number. speed_m_s: at the surface, towards the object; squeeze_m: how far inside
    it the hands rest; squeeze_s: from the surface to there; each replaces what the number says."""
    given = {"speed_y": speed_m_s, "squeeze": squeeze_m, "squeeze_s": squeeze_s}
    rng = np.random.default_rng([variation, 0x6772])
    script = Grab()
    if variation:
        ranges = {
            "approach_s": (0.95, 1.15), "squeeze_s": (0.5, 0.65), "lift_s": (1.1, 1.35), "carry_s": (0.5, 0.7),
            "lower_s": (1.05, 1.2), "speed_y": (0.3, 0.38), "speed_z": (0.12, 0.16), "squeeze": (0.105, 0.13),
            "lift": (0.2, 0.27), "carry_x": (-0.04, 0.08), "height": (0.01, 0.03),
        }  # fmt: skip
        drawn: dict[str, Any] = {name: rng.uniform(*ends) for name, ends in ranges.items()}  # in this order
        script = Grab(**drawn, lag_s=(rng.uniform(0.0, 0.004), rng.uniform(0.0, 0.004)))
    return replace(script, **{name: value for name, value in given.items() if value is not None})


def duration_s(script: Grab) -> float:
    """Length of the demonstration, s, with a rest at its end."""
    moving = script.approach_s + script.lift_s + script.carry_s + script.lower_s + script.release_s
    return 2 * script.rest_s + moving


def scripted_targets(
    script: Grab, models: tuple[ArmModel, ArmModel], homes: Array, thing: ObjectDescription, table: Table,
    period_s: float,
) -> NDArray[np.void]:  # fmt: skip
    """Return the operator's target frames, (2, n) of POINT, one a tick, for arms that start at `homes` (2, 7) rad.

    On the way the pads' faces turn parallel to the object's sides: one that meets a side at an angle of some degrees
    turns the object, in another way in each trial.
    """
    from scipy.spatial.transform import Rotation  # half a second, which most programs need not spend

    n = round(duration_s(script) / period_s)
    targets = np.zeros((2, n), POINT)
    centre_z = table.top_z + thing.size[2] / 2
    for arm, model in enumerate(models):
        start, rotation = end_effector_pose(model, homes[arm])
        inward = -np.sign(start[1])
        t = np.arange(n) * period_s - script.lag_s[arm]
        touch = script.rest_s + script.approach_s
        surface = -inward * thing.size[1] / 2
        lower = touch + script.lift_s + script.carry_s
        release = lower + script.lower_s
        end = release + script.release_s
        inside = surface + inward * script.squeeze
        contact_z = max(centre_z + script.height, start[2] + LEAST_RISE_M)
        steady = touch - script.steady_s
        steady_y = surface - inward * script.speed_y * script.steady_s
        steady_z = contact_z - script.speed_z * script.steady_s
        # at half the final speed on average, so that the path rises all the way and never dips towards the table
        rise_s = 2.0 * (steady_z - start[2]) / script.speed_z
        paths = (
            [ViaPoint(touch + script.lift_s, start[0]), ViaPoint(lower, start[0] + script.carry_x)],
            [
                ViaPoint(script.rest_s, start[1]), ViaPoint(steady, steady_y, inward * script.speed_y),
                ViaPoint(touch, surface, inward * script.speed_y), ViaPoint(touch + script.squeeze_s, inside),
                ViaPoint(release, inside), ViaPoint(end, surface - inward * script.retreat),
            ],
            [
                ViaPoint(steady - rise_s, start[2]), ViaPoint(steady, steady_z, script.speed_z),
                ViaPoint(touch, contact_z, script.speed_z), ViaPoint(touch + script.lift_s, contact_z + script.lift),
                ViaPoint(lower, contact_z + script.lift), ViaPoint(release, contact_z),
            ],
        )  # fmt: skip
        for axis, points in enumerate(paths):
            targets[arm]["position"][:, axis], targets[arm]["twist"][:, axis] = quintic_path(points, t)
        targets[arm]["rotation"] = rotation
        turn = turn_to_object(rotation, inward)
        if turn.any():
            share, rate = quintic_path([ViaPoint(script.rest_s, 0.0), ViaPoint(steady, 1.0)], t)
            targets[arm]["rotation"] = Rotation.from_rotvec(share[:, None] * turn).as_matrix() @ rotation
            targets[arm]["twist"][:, 3:] = rate[:, None] * turn
        targets[arm]["xi"] = homes[arm, 0]
    return targets


def turn_to_object(rotation: Array, inward: float) -> Array:
    """Return the shortest rotation vector (3,) along the world's axes, rad, by which a pad of this rotation (3, 3) has
    to turn for its face, its z, to look along the world's y (inward 1) or against it (-1); zero within FLAT_RAD."""
    towards = np.array([0.0, inward, 0.0])
    axis = np.cross(rotation[:, 2], towards)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, rotation[:, 2] @ towards)
    return axis * (angle / sine) if sine > FLAT_RAD else np.zeros(3)


def end_effector_pose(model: ArmModel, q: Array) -> tuple[Array, Array]:
    """Return position (3,) and rotation (3, 3) of the pad's face in the world at q (7,)."""
    model.update(q, np.zeros(7))
    return model.p7 + model.R7 @ model.face, model.R7 @ model.R_joint_ee
