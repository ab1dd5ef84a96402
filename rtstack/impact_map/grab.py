"""A grab planned through its impact: from the ante-impact reference at the nominal impact to the velocities after it.

A reference's pose and twist, and position and velocity of one joint, which takes up the redundancy (Section IV-A of the
impact-map paper), are seven numbers for seven joints: they determine configuration and velocity of the arm. The map of
the scene there is (14), what the post-impact reference begins with.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array, seven
from hal.pad import Pad
from rtstack.impact_map.bodies import moved_to
from rtstack.impact_map.map import impact_map
from rtstack.impact_map.result import ImpactMap, MapKind
from rtstack.impact_map.scene import Arm, Box, Contact, Plane, ReflectedInertia, Scene, SceneError
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, CellDescription
from rtstack.model.rotation import log_so3
from rtstack.samples import SIDES

POSTURE_JOINT = 0  # the paper's choice
STEPS = 100
PLACED = 1e-10  # m, rad


@dataclass(frozen=True, slots=True)
class GrabImpact:
    """A grab's nominal impact. Arrays of both arms, (left, right).

    q (2, 7) rad; dq_before, dq_after (2, 7) rad/s; twist (2, 6): of the pads' faces after the impact, along the world's
    axes, linear first; dxi (2,) rad/s: velocity of the posture's joint after it. map: everything else, its status
    first.
    """

    q: Array
    dq_before: Array
    dq_after: Array
    twist: Array
    dxi: Array
    map: ImpactMap


def grab_impact(
    description: CellDescription, object_name: str, ante: NDArray[np.void], pad_friction: float, table_friction: float,
    reflected: ReflectedInertia = ReflectedInertia.B_THETA, object_xy: tuple[float, float] = (0.0, 0.0),
    kind: MapKind = MapKind.CONVERGED,
) -> GrabImpact:  # fmt: skip
    """Return the nominal impact of a grab whose ante-impact reference ends in `ante`, (2,) of POINT (left, right).

    object_xy: where the object stands on the table, m; kind: of the map whose velocities are returned. Raises
    SceneError where an arm cannot be in that pose, or its pad does not touch the object there, KeyError for an object
    that is not there.
    """
    mountings = description.arms
    q, dq = np.empty((2, 7)), np.empty((2, 7))
    for k, (side, mounting) in enumerate(zip(SIDES, mountings, strict=True)):
        try:
            q[k], dq[k] = joint_state(mounting, description.pad, ante[k])
        except SceneError as error:
            raise SceneError(f"{side} arm: {error}") from None
    scene = grab_scene(description, object_name, q, dq, pad_friction, table_friction, reflected, object_xy)
    result = impact_map(scene)
    after = np.array([result.velocity(side, result.of(kind)) for side in SIDES])
    twist = np.array([result.twist(side, result.of(kind)) for side in SIDES])
    return GrabImpact(q, dq, after, twist, after[:, POSTURE_JOINT], result)


def grab_scene(
    description: CellDescription, object_name: str, q: Array, dq: Array, pad_friction: float, table_friction: float,
    reflected: ReflectedInertia = ReflectedInertia.B_THETA, object_xy: tuple[float, float] = (0.0, 0.0),
) -> Scene:  # fmt: skip
    """Return the scene of a cell's first arms at q (arms, 7) rad, with dq (arms, 7) rad/s, and a resting object."""
    thing, top = description.objects[object_name], description.table.top_z
    sides = description.sides[: len(q)]
    arms = {
        side: Arm(
            arm.base_position, seven(q[k]), arm.base_orientation_wxyz, dq=seven(dq[k]), model=arm.model, pad=arm.pad
        )
        for k, (side, arm) in enumerate(zip(sides, description.arms, strict=False))
    }
    touching = [Contact((side, "object"), pad_friction) for side in sides]
    return Scene(
        (*touching, Contact(("object", "table"), table_friction)), arms,
        objects={"object": Box(thing.mass, thing.size, (*object_xy, top + thing.size[2] / 2))},
        supports={"table": Plane((0.0, 0.0, top), (0.0, 0.0, 1.0))}, pad=description.pad, reflected=reflected,
    )  # fmt: skip


def joint_state(mounting: ArmMounting, pad: Pad, point: NDArray) -> tuple[Array, Array]:
    """Return q (7,) rad and dq (7,) rad/s of an arm in the pose and with the velocities of `point`, () of POINT.

    Newton's method from the arm's home; raises SceneError where it does not come there.
    """
    q, dq, _ = joint_state_near(ArmModel(mounting, pad), np.array(mounting.home), point)
    return q, dq


def joint_state_near(model: ArmModel, q: Array, point: NDArray) -> tuple[Array, Array, Array]:
    """Return the same, nearest to q, and the Jacobian (7, 7) of the twist and the posture's joint; the model is at the
    q that was found."""
    found = placed(model, q, point["position"], point["rotation"], float(point["xi"]))
    if found is None:
        place = np.round(point["position"], 3).tolist()
        raise SceneError(f"no configuration with the pad at {place} and joint 1 at {point['xi']:.3f} rad")
    q, J = found
    return q, np.linalg.solve(J, np.append(point["twist"], point["dxi"])), J


def placed(
    model: ArmModel, q: Array, position: Array | tuple[float, float, float], rotation: Array,
    posture: float | None = None, steps: int = STEPS,
) -> tuple[Array, Array] | None:  # fmt: skip
    """Return a configuration (7,) rad near q with the pad's face there, by Newton's method, and the Jacobian of its
    twist, (6, 7), or (7, 7) with the posture's joint where that is to be at `posture`, rad; None where it does not
    come there in so many steps. position (3,) m and rotation (3, 3) in the world. The model is at the q that was found.
    """
    rotation_error = np.empty(3)
    for _ in range(steps):
        model.update(q, np.zeros(7))
        face = model.p7 + model.R7 @ model.face
        log_so3(rotation @ (model.R7 @ model.R_joint_ee).T, rotation_error)
        error, J = np.concatenate([position - face, rotation_error]), moved_to(face, model.J0)
        if posture is not None:
            error, J = np.append(error, posture - q[POSTURE_JOINT]), np.vstack([J, np.eye(7)[POSTURE_JOINT]])
        if np.abs(error).max() <= PLACED:
            return q, J
        step = np.linalg.lstsq(J, error)[0]
        q = q + step / max(1.0, float(np.abs(step).max()) / 0.3)
    return None
