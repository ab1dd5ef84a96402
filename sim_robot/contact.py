"""Contact stiffness and damping: physical numbers into MuJoCo's direct solref.

MuJoCo holds a contact point with f = (a_ref - a_0) / (A + R), where a_ref = -(b / d) v - (k / d) r and R =
A_diag (1 - d) / d, for solref = (-k, -b) and a constant impedance d; k and b are mass-normalised (1/s^2,
1/s). At rest this is a spring of k / ((1 - d) A_diag) newton a metre whatever d is; with a small d it is that
spring, and the damper b / ((1 - d) A_diag), in motion too. A_diag is what the compiler estimated for the two
bodies, so the wanted stiffness K and damping C of one point give k = K (1 - d) A_diag and b = C (1 - d)
A_diag. Four points, the corners of the pad's face or of the object's base, share a face.
"""

from math import sqrt

import mujoco
import numpy as np

from sim_robot.scene import GraspObject, Scene

POINTS_PER_FACE = 4.0


def series(stiffness: float, other: float) -> float:
    """Stiffness of two springs in series, N/m."""
    return 1.0 / (1.0 / stiffness + 1.0 / other)


def set_contacts(model: mujoco.MjModel, scene: Scene, thing: GraspObject, known: tuple[float | None, ...]) -> None:
    """Set solref and solimp of every geom: pads (or fingers) on the object or on the platform, the object
    on the table, hard links. known: the stiffness of a pad on the object, N/m, where it was identified, of each arm.

    The damping on an object is 2 zeta sqrt(K m), m the object's mass: the ratio of the object alone on that face.
    """

    def damping(stiffness: float) -> float:
        return 2.0 * thing.damping_ratio * sqrt(stiffness * thing.mass)

    weights = model.body_invweight0[:, 0]
    w_object = weights[model.body("object").id]
    on_table = series(thing.stiffness, scene.table.stiffness)
    _set(model, slice(None), scene, on_table, damping(on_table), w_object)
    for side, place, identified in zip(scene.sides, scene.arms, known, strict=True):
        ends, on_end = [f"{side}_pad"], identified or series(thing.stiffness, scene.pad.stiffness)
        if place.hand is not None:
            ends, on_end = [f"{side}_finger{k}" for k in (1, 2)], series(thing.stiffness, place.hand.stiffness)
        for end in ends:
            geom, weight = model.geom(end).id, weights[model.body(end).id]
            if scene.platform is not None and place.hand is None:  # which does not move
                _set(model, geom, scene, scene.platform.stiffness, scene.platform.damping, weight)
            else:
                _set(model, geom, scene, on_end, damping(on_end), w_object + weight)


def _set(
    model: mujoco.MjModel, geoms: slice | int, scene: Scene, stiffness: float, damping: float, inverse_mass: float
) -> None:
    d = scene.contact.impedance
    normalised = (1.0 - d) * inverse_mass / POINTS_PER_FACE
    model.geom_solref[geoms] = (-stiffness * normalised, -damping * normalised)
    model.geom_solimp[geoms] = np.array([d, d, 1e-3, 0.5, 2.0])  # constant impedance
