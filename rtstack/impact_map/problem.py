"""A scene as the numbers of an impact: mass matrix, contact Jacobian, velocities, friction.

The velocity is whitened: w = L^T v with M = L L^T, so that kinetic energy is |w|^2 / 2, an impulse's effect is
w+ = w- + A lambda with A = L^-1 J^T, and contact velocities are A^T w - s, with s the supports' own velocity.
"""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from hal.base.arrays import Array
from rtstack.impact_map.bodies import Body, BoxBody, arm_body
from rtstack.impact_map.patch import Face, Patch, face_on_face, face_on_plane, frame_of
from rtstack.impact_map.scene import Contact, Scene, SceneError, check_scene

JOINTS = 7  # velocities of an arm; a box has 6
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # of a cross product


@dataclass(frozen=True, slots=True)
class Problem:
    """The impact of a scene with n contact points and nv velocities.

    names, bodies, slices: the moving bodies and where their velocities are. contacts, patches, points: the scene's
    contacts, where they touch, and which of the n points are theirs. M (nv, nv) mass matrix, velocity (nv,) before the
    impact, J (3n, nv) contact Jacobian, s (3n,) m/s velocity of the supports, friction (n,).

    What follows from them: whitening (nv, nv) = L^-1, A (nv, 3n) 1/sqrt(kg), w (nv,) sqrt(J).
    """

    names: tuple[str, ...]
    bodies: tuple[Body, ...]
    slices: tuple[slice, ...]
    contacts: tuple[Contact, ...]
    patches: tuple[Patch, ...]
    points: tuple[slice, ...]
    M: Array
    velocity: Array
    J: Array
    s: Array
    friction: Array
    whitening: Array = field(init=False)
    A: Array = field(init=False)
    w: Array = field(init=False)

    def __post_init__(self) -> None:
        """Whiten. Raises numpy's LinAlgError where M is not positive definite."""
        L = np.linalg.cholesky(self.M)
        whitening = np.linalg.inv(L)
        for name, value in (("whitening", whitening), ("A", whitening @ self.J.T), ("w", self.velocity @ L)):
            object.__setattr__(self, name, value)

    def coloured(self, w: Array) -> Array:
        """Return the generalised velocity (nv,) of a whitened one."""
        return w @ self.whitening

    def maintained(self) -> Iterator[int]:
        """Yield the contacts that are pressed together."""
        arms = {name for name, body in zip(self.names, self.bodies, strict=True) if len(body.velocity) == JOINTS}
        for k, contact in enumerate(self.contacts):
            if contact.between[0] in arms if contact.maintained is None else contact.maintained:
                yield k


def problem_of(scene: Scene) -> Problem:
    """Return the numbers of a scene. Raises SceneError where a contact does not touch."""
    check_scene(scene)
    pads: dict[str, Face] = {}
    boxes = {name: BoxBody(box) for name, box in scene.objects.items()}
    bodies: dict[str, Body] = {}
    for name, arm in scene.arms.items():
        bodies[name], pads[name] = arm_body(arm, scene.pad, scene.reflected)
    bodies.update((name, box.body) for name, box in boxes.items())
    patches = [_patch(k, contact, scene, pads, boxes) for k, contact in enumerate(scene.contacts)]
    points = slices_of(len(patch.points) for patch in patches)
    slices = slices_of(len(body.velocity) for body in bodies.values())
    at = dict(zip(bodies, slices, strict=True))
    nv, rows = slices[-1].stop, 3 * points[-1].stop
    M, velocity, J, s = np.zeros((nv, nv)), np.zeros(nv), np.zeros((rows, nv)), np.zeros(rows)
    friction = np.empty(points[-1].stop)
    for name, body in bodies.items():
        M[at[name], at[name]] = body.M
        velocity[at[name]] = body.velocity
    for contact, patch, where in zip(scene.contacts, patches, points, strict=True):
        its = slice(3 * where.start, 3 * where.stop)
        motion = _motion(patch)
        first, second = contact.between
        J[its, at[first]] = motion @ bodies[first].origin
        if second in bodies:
            J[its, at[second]] = -motion @ bodies[second].origin
        else:
            s[its] = motion[:, :3] @ scene.supports[second].velocity
        friction[where] = contact.friction
    return Problem(
        tuple(bodies), tuple(bodies.values()), slices, scene.contacts, tuple(patches), points, M, velocity, J, s,
        friction,
    )  # fmt: skip


def slices_of(lengths: Iterable[int]) -> tuple[slice, ...]:
    """Return where parts of these lengths are, one behind the other."""
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(slice(a, b) for a, b in itertools.pairwise(ends))


def _motion(patch: Patch) -> Array:
    """Return the velocities of a patch's points in its frame, (3n, 6), from a twist at the world's origin: along an
    axis t, t (v + w x p) = t v + (p x t) w."""
    p, t = patch.points[:, None, :], patch.frame.T[None]
    motion = np.empty((len(patch.points), 3, 6))
    motion[:, :, :3] = t
    motion[:, :, 3:] = p[..., _NEXT] * t[..., _LAST] - p[..., _LAST] * t[..., _NEXT]
    return motion.reshape(-1, 6)


def _patch(k: int, contact: Contact, scene: Scene, pads: dict[str, Face], boxes: dict[str, BoxBody]) -> Patch:
    if contact.points is not None and contact.normal is not None:
        return Patch(np.array(contact.points), frame_of(np.array(contact.normal)))
    first, second = contact.between
    if second in boxes:
        other = boxes[second]
        if first in pads:
            face = pads[first]
        else:
            face = boxes[first].face(other.body.place - boxes[first].body.place)
        patch = face_on_face(face, other.face(-face.axes[:, 2]))
    else:
        plane = scene.supports[second]
        normal = np.array(plane.normal)
        face = pads[first] if first in pads else boxes[first].face(-normal)
        patch = face_on_plane(face, np.array(plane.point), normal)
    if patch is None:
        raise SceneError(f"key contacts.{k}: {first} does not touch {second}: move them together, or give points")
    return patch
