"""The problem of an impact from other people's models: a MuJoCo model in a state, a URDF in a configuration."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from hal.base.arrays import numbers
from hal.base.extras import advice
from rtstack.impact_map.arrays import problem_from_arrays
from rtstack.impact_map.patch import frame_of
from rtstack.impact_map.problem import Problem
from rtstack.impact_map.scene import SceneError

if TYPE_CHECKING:
    import mujoco


def problem_from_mujoco(
    model: "mujoco.MjModel", data: "mujoco.MjData", pairs: Iterable[tuple[str, str]] | None = None,
    maintained: bool = False,
) -> Problem:  # fmt: skip
    """Return the problem of the contacts that MuJoCo has found, after `mj_forward(model, data)`.

    Velocities are data.qvel (nv,). M holds each joint's armature, the reflected inertia of its motor. The contacts of a
    pair of geoms are a patch, whose first body has the second geom: MuJoCo's normal points there. Of friction only that
    against sliding is taken (0 where condim is 1); damping, limits of joints and actuators are not.

    Args:
        model: Any model without active equality constraints.
        data: Its state.
        pairs: Names of geoms whose contacts count, in either order; by default all.
        maintained: Whether all patches are pressed together: see `problem_from_arrays`.

    Raises:
        SceneError: MuJoCo is not installed, nothing touches, or the map does not know what the model has.
        TypeError: Not a model and its data.
    """
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise SceneError(advice(error.name) or str(error)) from None
    if not (isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)):
        found = f"{type(model).__name__} and {type(data).__name__}"
        raise TypeError(f"model, data: expected mujoco.MjModel and mujoco.MjData, found {found}")
    if data.ne:
        raise SceneError("the model has active equality constraints, which an impact map does not know: disable them")
    try:
        wanted = None if pairs is None else {frozenset(model.geom(name).id for name in pair) for pair in pairs}
    except (KeyError, ValueError, TypeError) as error:
        raise SceneError(f"pairs: {str(error.args[0]).splitlines()[0]}") from None
    touching = [c for c in data.contact if not c.exclude and (wanted is None or frozenset(c.geom.tolist()) in wanted)]
    if not touching or min(c.geom.min() for c in touching) < 0:
        raise SceneError(f"expected contacts of geoms, found none among {data.ncon}: call mj_forward where geoms touch")
    M, J = np.zeros((model.nv, model.nv)), np.zeros((len(touching), 3, model.nv))
    for column, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    frames, friction, labels, other = [], [], [], np.zeros((3, model.nv))
    for k, contact in enumerate(touching):
        second, first = model.geom_bodyid[contact.geom]
        mujoco.mj_jac(model, data, J[k], None, contact.pos, first)
        mujoco.mj_jac(model, data, other, None, contact.pos, second)
        J[k] -= other
        frames.append(np.roll(contact.frame.reshape(3, 3), -1, axis=0).T)  # MuJoCo's rows: normal, tangent, tangent
        labels.append(" on ".join(model.geom(geom).name or f"geom {geom}" for geom in contact.geom[::-1]))
        friction.append(contact.friction[0] if contact.dim > 1 else 0.0)
        if contact.dim > 1 and contact.friction[0] != contact.friction[1]:
            raise SceneError(f"contact {k}: expected one sliding friction, found {contact.friction[:2].tolist()}")
    return problem_from_arrays(
        M, J.reshape(-1, model.nv), data.qvel, friction, frames=frames, patches=labels, maintained=maintained
    )


def problem_from_urdf(
    urdf: Path | str, q: ArrayLike, dq: ArrayLike, links: Sequence[str], points: ArrayLike, normals: ArrayLike,
    friction: ArrayLike, *, support_velocity: ArrayLike | None = None, armature: ArrayLike | None = None,
    free_base: bool = False, maintained: bool = False,
) -> Problem:  # fmt: skip
    """Return the problem of a robot of any number of joints that hits its surroundings at n points.

    Args:
        urdf: File of the model; meshes are not read.
        q: Pinocchio's configuration (nq,), rad and m: a continuous joint has cosine and sine, a free base position and
            quaternion xyzw.
        dq: Velocity before the impact (nv,), rad/s and m/s.
        links: Name of the link, or of another frame of the URDF, of each point (n). Consecutive points of a link are a
            patch.
        points: Where they are in the frames of their links (n, 3) m.
        normals: Outward normals of what is hit, along the world's axes (n, 3).
        friction: Coulomb's coefficient at each point (n,), or one for all.
        support_velocity: Of what is hit, along the world's axes (n, 3) m/s; by default 0.
        armature: Reflected inertia of the motors (nv,) kg m^2; a URDF has none.
        free_base: Whether the robot's base is free to move.
        maintained: Whether all patches are pressed together: see `problem_from_arrays`.

    Raises:
        SceneError: A file that is no URDF, or a link that it does not have.
        ValueError: An array that does not fit.
    """
    try:
        model = pin.buildModelFromUrdf(str(urdf), *([pin.JointModelFreeFlyer()] if free_base else []))
    except ValueError as error:
        raise SceneError(f"{urdf}: not a URDF that Pinocchio reads: {str(error).splitlines()[0]}") from None
    q, dq = numbers(q, "q", (model.nq,)), numbers(dq, "dq", (model.nv,))
    added = numbers(np.zeros(model.nv) if armature is None else armature, "armature", (model.nv,))
    n = len(links)
    places, directions = numbers(points, "points", (n, 3)), numbers(normals, "normals", (n, 3))
    if not directions.any(axis=1).all():
        raise ValueError("normals: expected directions, found zeros")
    directions = directions / np.abs(directions).max(axis=1, keepdims=True)  # of any size
    data = model.createData()
    M = np.triu(pin.crba(model, data, q, pin.Convention.WORLD))  # crba fills the upper triangle only
    M += np.triu(M, 1).T + np.diag(added)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    J = np.zeros((n, 3, model.nv))
    for k, link in enumerate(links):
        if not isinstance(link, str) or not model.existFrame(link):
            raise SceneError(f"links: expected frames of {urdf}, found {link!r}")
        frame = model.getFrameId(link)
        moving = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        J[k] = moving[:3] - pin.skew(data.oMf[frame].rotation @ places[k]) @ moving[3:]
    frames = np.reshape([frame_of(direction) for direction in directions], (-1, 3, 3))
    return problem_from_arrays(
        M, J.reshape(-1, model.nv), dq, friction, frames=frames, support_velocity=support_velocity,
        patches=links, maintained=maintained,
    )  # fmt: skip
