"""Scenes of impacts by seed: grabs, pushes, falling boxes, stacks; any friction, velocity and reflected inertia."""

from dataclasses import replace

import numpy as np

from rtstack.impact_map import Arm, Box, Contact, Plane, ReflectedInertia, Scene
from rtstack.impact_map.bodies import arm_body
from rtstack.impact_map.scene import DEFAULT_PAD

KINDS = ("grab", "grab", "push", "fall", "stack")
# both pads' faces at y = +-0.15 m, z = 0.3 m
LEFT_Q = np.array([-0.559731, 0.121163, 0.017681, -2.391737, -2.025175, 1.877568, 1.012942])
MIRROR = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def random_scene(seed):
    """Return a scene whose bodies touch."""
    rng = np.random.default_rng(seed)
    while True:
        kind = rng.choice(KINDS)
        scene = _scene(kind, rng)
        if scene is not None:
            return scene


def frictionless(scene):
    """Return the same scene without friction."""
    return replace(scene, contacts=tuple(replace(contact, friction=0.0) for contact in scene.contacts))


def _scene(kind, rng):
    reflected = rng.choice(list(ReflectedInertia))
    left, left_face = _arm("left", rng)
    right, right_face = _arm("right", rng)
    across = left_face.centre - right_face.centre
    if kind == "push":
        across = -left_face.axes[:, 2] * rng.uniform(0.2, 0.4) + rng.normal(0.0, 0.01, 3)
    y = across / np.linalg.norm(across)
    z = np.array([0.0, 0.0, 1.0]) + rng.normal(0.0, 0.1, 3)
    z -= y * (z @ y)
    z /= np.linalg.norm(z)
    R = np.column_stack([np.cross(y, z), y, z])
    if -left_face.axes[:, 2] @ y < 0.93 or (kind != "push" and right_face.axes[:, 2] @ y < 0.93):
        return None  # the pads do not face the box
    size = np.array([rng.uniform(0.08, 0.4), np.linalg.norm(across), rng.uniform(0.08, 0.4)])
    centre = left_face.centre - across / 2
    box = _box(rng, size, centre, R)
    table = Plane(point=tuple(centre - z * size[2] / 2), normal=tuple(z))
    on_table = Contact(("box", "table"), _friction(rng))
    objects, contacts, arms = {"box": box}, [on_table], {}
    if kind in ("grab", "stack", "push"):
        arms["left"] = left
        contacts.append(Contact(("left", "box"), _friction(rng)))
    if kind in ("grab", "stack"):
        arms["right"] = right
        contacts.append(Contact(("right", "box"), _friction(rng)))
    if kind == "stack":
        lid = rng.uniform(0.1, 0.3, 3)
        above = centre + z * (size[2] + lid[2]) / 2 + R[:, :2] @ rng.uniform(-0.02, 0.02, 2)
        objects["lid"] = _box(rng, lid, above, R)
        contacts.append(Contact(("lid", "box"), _friction(rng)))
    if kind == "fall":
        box = replace(box, velocity=tuple(rng.normal(0.0, 0.5, 3)), angular_velocity=tuple(rng.normal(0.0, 2.0, 3)))
        objects["box"] = box
    return Scene(contacts=tuple(contacts), arms=arms, objects=objects, supports={"table": table}, reflected=reflected)


def _arm(side, rng):
    left = side == "left"
    q = (LEFT_Q if left else LEFT_Q * MIRROR) + rng.normal(0.0, 0.06, 7)
    y = 0.5 if left else -0.5
    towards = -1.0 if left else 1.0
    linear = np.array([0.0, towards * rng.uniform(0.05, 1.0), 0.0]) + rng.normal(0.0, 0.2, 3)
    if rng.random() < 0.3:
        arm = Arm((-0.4, y, 0.0), tuple(q), dq=tuple(rng.normal(0.0, 0.5, 7)))
    else:
        arm = Arm((-0.4, y, 0.0), tuple(q), pad_twist=(*linear, *rng.normal(0.0, 0.3, 3)))
    return arm, arm_body(arm, DEFAULT_PAD, ReflectedInertia.NONE)[1]


def _box(rng, size, centre, rotation):
    mass = rng.uniform(0.3, 4.0)
    given = rng.random() < 0.3
    squares = size**2
    inertia = mass / 12.0 * (squares.sum() - squares) * rng.uniform(0.8, 1.2) if given else None
    still = rng.random() < 0.5
    return Box(
        mass=mass,
        size=tuple(size),
        position=tuple(centre),
        orientation_wxyz=tuple(_quaternion(rotation)),
        inertia=None if inertia is None else tuple(inertia),
        velocity=(0.0, 0.0, 0.0) if still else tuple(rng.normal(0.0, 0.1, 3)),
        angular_velocity=(0.0, 0.0, 0.0) if still else tuple(rng.normal(0.0, 0.3, 3)),
    )


def _friction(rng):
    return 0.0 if rng.random() < 0.1 else float(rng.uniform(0.1, 1.0))


def _quaternion(rotation):
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
