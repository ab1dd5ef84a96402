"""A scene as the numbers of an impact: mass matrix, contact Jacobian, velocities, friction.

The velocity is whitened: w = L^T v with M = L L^T, so that kinetic energy is |w|^2 / 2, an impulse's effect is
w+ = w- + A lambda with A = L^-1 J^T, and contact velocities are A^T w - s, with s the supports' own velocity.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.impact_map.bodies import Body, BoxBody, arm_body, skew
from rtstack.impact_map.patch import Face, Patch, face_on_face, face_on_plane, frame_of
from rtstack.impact_map.scene import Contact, Scene, SceneError, check_scene

Array = NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class Problem:
    """The impact of a scene with n contact points and nv velocities.

    names, bodies, slices: the moving bodies and where their velocities are. patches: the scene's contacts, with the
    rows (points) of each. A (nv, 3n) 1/sqrt(kg), w (nv,) sqrt(J) before the impact, s (3n,) m/s, friction (n,).
    factors: L of each body.
    """

    names: tuple[str, ...]
    bodies: tuple[Body, ...]
    slices: tuple[slice, ...]
    contacts: tuple[Contact, ...]
    patches: tuple[Patch, ...]
    points: tuple[slice, ...]
    A: Array
    w: Array
    s: Array
    friction: Array
    factors: tuple[Array, ...]

    def velocity(self, w: Array) -> Array:
        """Return the generalised velocity (nv,) of a whitened one."""
        out = np.empty_like(w)
        for at, L in zip(self.slices, self.factors, strict=True):
            out[at] = np.linalg.solve(L.T, w[at])
        return out

    def maintained(self) -> Iterator[int]:
        """Yield the contacts that somebody presses together."""
        arms = {name for name, body in zip(self.names, self.bodies, strict=True) if len(body.velocity) == 7}
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
    points = _slices(len(patch.points) for patch in patches)
    slices = _slices(len(body.velocity) for body in bodies.values())
    at = dict(zip(bodies, slices, strict=True))
    J = np.zeros((3 * points[-1].stop, slices[-1].stop if slices else 0))
    s = np.zeros(len(J))
    for contact, patch, rows in zip(scene.contacts, patches, points, strict=True):
        rows = slice(3 * rows.start, 3 * rows.stop)
        motion = _motion(patch)
        first, second = contact.between
        J[rows, at[first]] = motion @ bodies[first].origin
        if second in bodies:
            J[rows, at[second]] = -motion @ bodies[second].origin
        else:
            s[rows] = np.tile(patch.frame.T @ np.array(scene.supports[second].velocity), len(patch.points))
    factors = tuple(np.linalg.cholesky(body.M) for body in bodies.values())
    A, w = np.empty((J.shape[1], len(J))), np.empty(J.shape[1])
    for body, L, columns in zip(bodies.values(), factors, slices, strict=True):
        A[columns] = np.linalg.solve(L, J[:, columns].T)
        w[columns] = L.T @ body.velocity
    friction = np.concatenate([np.full(len(p.points), c.friction) for c, p in zip(scene.contacts, patches, strict=True)])
    return Problem(
        tuple(bodies), tuple(bodies.values()), slices, scene.contacts, tuple(patches), points, A, w, s, friction, factors
    )


def _slices(lengths: Iterable[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(slice(a, b) for a, b in zip(ends, ends[1:], strict=False))


def _motion(patch: Patch) -> Array:
    """Return the velocities of a patch's points in its frame, (3n, 6), from a twist at the world's origin: v - p x w."""
    blocks = [np.hstack([patch.frame.T, -patch.frame.T @ skew(p)]) for p in patch.points]
    return np.vstack(blocks)


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
