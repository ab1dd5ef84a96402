"""Which geoms MuJoCo looks at: those that may touch another one before the next look (decision 68). Compiled.

A geom all of whose pairs are surely farther apart than everything has moved since the last look is left out by its
collision masks. The contacts, and what is simulated, are the same to the last bit.
"""

from math import sqrt

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS

FAR_M = 0.01  # pairs that are farther apart are left out until something has moved so far
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)

# of two geoms that may meet; seen: m, from where on MuJoCo finds a contact
PAIR = np.dtype([("one", "i8"), ("other", "i8"), ("seen", "f8")])
# collision masks of a geom, and its body
MASKS = np.dtype([("contype", "i4"), ("conaffinity", "i4"), ("body", "i8"), ("near", "i8")])


def near_dtype(arms: int, positions: int) -> np.dtype:
    """Return the record of what is remembered.

    reach: how far any point of an arm is from any of its joints at most, object: any point from its middle, m; moved:
    the sum of what arms and object have moved since the last look, step: in the last substep, room: of the pairs that
    are left out, how much they may, m. qpos: of the last look; fixed: 1 where no geom is ever left out.
    """
    numbers = ("object", "moved", "step", "room")
    kinds = [("reach", "f8", (arms,)), *((name, "f8") for name in numbers), ("qpos", "f8", positions), ("fixed", "i8")]
    return np.dtype(kinds)


def pairs_of(model: mujoco.MjModel) -> NDArray[np.void]:
    """Return the PAIRs (n,) of a model: what may meet by its masks, and does not stand still."""
    one, other = np.triu_indices(model.ngeom, 1)
    contype, conaffinity, body = model.geom_contype, model.geom_conaffinity, model.body_weldid[model.geom_bodyid]
    meet = (contype[one] & conaffinity[other]) | (contype[other] & conaffinity[one])
    chosen = (meet != 0) & (body[one] != body[other])
    pairs = np.zeros(int(chosen.sum()), PAIR)
    pairs["one"], pairs["other"] = one[chosen], other[chosen]
    seen = model.geom_margin + model.geom_gap
    pairs["seen"] = seen[pairs["one"]] + seen[pairs["other"]]
    return pairs


def masks_of(model: mujoco.MjModel) -> NDArray[np.void]:
    """Return the MASKS (n,) of a model's geoms."""
    masks = np.zeros(model.ngeom, MASKS)
    masks["contype"], masks["conaffinity"] = model.geom_contype, model.geom_conaffinity
    masks["body"] = model.geom_bodyid
    return masks


def near_of(model: mujoco.MjModel, first_bodies: tuple[int, ...], object_body: int, fixed: bool) -> NDArray[np.void]:
    """Return the memory (1,) of near_dtype. first_bodies: the first link that moves of each arm."""
    near = np.zeros(1, near_dtype(len(first_bodies), model.nq))
    size = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
    for arm, first in enumerate(first_bodies):
        # a body comes after what it hangs on
        of_arm = (model.body_rootid == model.body_rootid[first]) & (np.arange(model.nbody) >= first)
        bodies = np.flatnonzero(of_arm)
        lengths = np.linalg.norm(model.body_pos[bodies], axis=1).sum()
        near["reach"][0, arm] = lengths + max(size[np.isin(model.geom_bodyid, bodies)], default=0.0)
    near["object"] = size[model.geom_bodyid == object_body].max()
    near["qpos"], near["fixed"] = np.nan, fixed
    return near


@compiled
def look_at_all(masks, contype, conaffinity, body_contype, body_conaffinity):
    """Leave no geom out. contype, conaffinity (n,): of MuJoCo's geoms; body_ (n,): of all geoms of a body."""
    for k in range(masks.shape[0]):
        masks[k].near = 1
    _show(masks, contype, conaffinity, body_contype, body_conaffinity)


@compiled
def _show(masks, contype, conaffinity, body_contype, body_conaffinity):
    for body in range(body_contype.shape[0]):
        body_contype[body] = body_conaffinity[body] = 0
    for k in range(masks.shape[0]):
        mask = masks[k]
        contype[k] = mask.contype if mask.near != 0 else 0
        conaffinity[k] = mask.conaffinity if mask.near != 0 else 0
        body_contype[mask.body] |= contype[k]
        body_conaffinity[mask.body] |= conaffinity[k]


@compiled
def look(pairs, masks, near, contype, conaffinity, body_contype, body_conaffinity, kinds, sizes, radii, xpos, xmat):
    """Leave out what is far; geoms (n,) of these kinds, sizes and bounding radii are at xpos and xmat."""
    room = np.inf
    for k in range(masks.shape[0]):
        masks[k].near = 0
    for k in range(pairs.shape[0]):
        pair = pairs[k]
        a, b = pair.one, pair.other
        apart = 0.0
        for i in range(3):
            apart += (xpos[a, i] - xpos[b, i]) ** 2
        apart = sqrt(apart) - radii[a] - radii[b]
        if kinds[a] == _BOX:
            apart = max(apart, _from_box(a, b, kinds, sizes, xpos, xmat))
        if kinds[b] == _BOX:
            apart = max(apart, _from_box(b, a, kinds, sizes, xpos, xmat))
        apart -= pair.seen
        if apart > FAR_M:
            room = min(room, apart)
        else:
            masks[a].near = masks[b].near = 1
    near.room = room
    near.moved = near.step  # since xpos, which is of the beginning of the last substep
    _show(masks, contype, conaffinity, body_contype, body_conaffinity)


@compiled
def _from_box(box, other, kinds, sizes, xpos, xmat):
    """Return how far another box or capsule is from a box at least, m: by what each extends along the box's axes."""
    total = 0.0
    for c in range(3):
        along = 0.0
        for r in range(3):
            along += xmat[box, 3 * r + c] * (xpos[other, r] - xpos[box, r])
        extent = 0.0 if kinds[other] == _BOX else sizes[other, 0]
        for k in range(3):
            half = sizes[other, k] if kinds[other] == _BOX else sizes[other, 1] if k == 2 else 0.0
            turned = 0.0
            for r in range(3):
                turned += xmat[box, 3 * r + c] * xmat[other, 3 * r + k]
            extent += half * abs(turned)
        beyond = max(0.0, abs(along) - sizes[box, c] - extent)
        total += beyond * beyond
    return sqrt(total)


@compiled
def note_motion(near, qvel, period_s):
    """Add what arms and object move at most in a substep that ends with these velocities."""
    moved = 0.0
    arms = len(near.reach)
    for arm in range(arms):
        turned = 0.0
        for j in range(JOINTS):
            turned += abs(qvel[arm * JOINTS + j])
        moved += turned * near.reach[arm]
    first = arms * JOINTS
    linear = turned = 0.0
    for i in range(3):
        linear += abs(qvel[first + i])
        turned += abs(qvel[first + 3 + i])
    near.step = (moved + linear + turned * near.object) * period_s
    near.moved += near.step
