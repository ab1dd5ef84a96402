"""The same impact by MuJoCo: a model of the scene with a small sphere at each contact point, and one very short step.

MuJoCo's law is the convex relaxation of Coulomb's, with a compliance of its own. Damping of 1/dt and no stiffness make
it plastic within the step. The impedance 0.9999, the largest that it takes, leaves 1e-4 of what it thinks the bodies'
inverse inertia is: a hundredth of that makes it rigid enough. The more rigid, the harder for its solver: where it uses
up its iterations, its step says nothing, and a softer one is taken.
"""

import mujoco
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from hal.robots import FR3
from rtstack.impact_map import solvers
from rtstack.impact_map.scene import joint_inertia
from sim_robot.arm_description import arm_description

DT = 1e-5  # s
RADIUS = 1e-3  # m, of a contact point
DEPTH = 1e-8  # m: what makes it touch
IMPEDANCE = 0.9999
ITERATIONS = 300
SHARES = (0.01, 0.03, 0.1)  # of the inverse inertia: the first one with which the solver converges


def relaxed_velocity(problem):
    """Return the generalised velocity (nv,) of the convex relaxation by Pinocchio's ADMM; None where it fails."""
    size = 3 * len(problem.friction)
    G, b = problem.A.T @ problem.A, problem.A.T @ problem.w - problem.s
    models, datas = solvers._constraints(tuple(problem.friction))
    for rule in (pin.ADMMUpdateRule.OSQP, pin.ADMMUpdateRule.SPECTRAL, pin.ADMMUpdateRule.LINEAR):
        settings, answer = pin.ADMMSolverSettings(), pin.ADMMSolverResult()
        settings.solve_ncp = False
        settings.admm_update_rule = rule
        settings.max_iterations = 10000
        settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-8
        settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
        delassus = pin.DelassusOperatorDense(G)
        if pin.ADMMConstraintSolver(size).solve(delassus, b, models, datas, settings, answer):
            return problem.coloured(problem.w + problem.A @ np.array(answer.retrieveConstraintImpulses()))
    return None


def mujoco_velocity(scene, problem):
    """Return the generalised velocity (nv,) after one step of MuJoCo; None where its solver does not converge."""
    model = mujoco.MjModel.from_xml_string(_mjcf(scene, problem))
    inverse_inertia = model.body_invweight0.copy()
    for share in SHARES:
        model.body_invweight0[:] = share * inverse_inertia
        data = _stepped(model, scene, problem)
        if data.solver_niter.max() < ITERATIONS:
            return _velocity(model, data, scene, problem)
    return None


def _stepped(model, scene, problem):
    data = mujoco.MjData(model)
    for name, at in zip(problem.names, problem.slices, strict=True):
        if name in scene.arms:
            joints = [model.joint(f"{name}{i}") for i in range(7)]
            for joint, q, dq in zip(joints, scene.arms[name].q, problem.velocity[at], strict=True):
                data.qpos[joint.qposadr[0]] = q
                data.qvel[joint.dofadr[0]] = dq
        else:
            first = model.joint(name).dofadr[0]
            data.qvel[first : first + 3] = problem.velocity[at][:3]
            data.qvel[first + 3 : first + 6] = _rotation(scene.objects[name]).T @ problem.velocity[at][3:]
    mujoco.mj_forward(model, data)
    data.qvel -= DT * data.qacc_smooth  # Coriolis forces make up for it within the step
    mujoco.mj_step(model, data)
    assert data.ncon == len(problem.friction)
    return data


def _velocity(model, data, scene, problem):
    velocity = np.empty_like(problem.velocity)
    for name, at in zip(problem.names, problem.slices, strict=True):
        if name in scene.arms:
            velocity[at] = [data.qvel[model.joint(f"{name}{i}").dofadr[0]] for i in range(7)]
        else:
            first = model.joint(name).dofadr[0]
            velocity[at] = [
                *data.qvel[first : first + 3],
                *_rotation(scene.objects[name]) @ data.qvel[first + 3 : first + 6],
            ]
    return velocity


def _mjcf(scene, problem):
    bodies, pairs = dict.fromkeys((*problem.names, *scene.supports), ""), ""
    places = {name: _place(scene, name) for name in bodies}
    for k, (contact, patch) in enumerate(zip(problem.contacts, problem.patches, strict=True)):
        first, second = contact.between
        n = patch.frame[:, 2]
        slab = _local(places[second], patch.points.mean(axis=0) - 0.01 * n, patch.frame)
        bodies[second] += f'<geom name="slab{k}" type="box" size="1 1 0.01" {slab}/>'
        for i, point in enumerate(patch.points):
            sphere = _local(places[first], point + (RADIUS - DEPTH) * n, np.eye(3))
            bodies[first] += f'<geom name="p{k}_{i}" type="sphere" size="{RADIUS}" {sphere}/>'
            mu = contact.friction
            law = f'condim="3" friction="{mu!r} {mu!r} 0 0 0"' if mu > 0.0 else 'condim="1"'
            pairs += f'<pair geom1="p{k}_{i}" geom2="slab{k}" {law}/>'
    tree = "".join(bodies[name] for name in scene.supports)
    for name, arm in scene.arms.items():
        tree += _arm(name, arm, scene, bodies[name])
    for name, box in scene.objects.items():
        a, b, c = box.size
        moments = box.inertia or [box.mass / 12 * s for s in (b * b + c * c, a * a + c * c, a * a + b * b)]
        tree += (
            f'<body name="{name}" pos="{_text(box.position)}" quat="{_text(box.orientation_wxyz)}">'
            f'<freejoint name="{name}"/><inertial pos="0 0 0" mass="{box.mass!r}" diaginertia="{_text(moments)}"/>'
            f"{bodies[name]}</body>"
        )
    solver = f'solref="{-1e-9} {-IMPEDANCE / DT}" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"'
    return (
        f'<mujoco><compiler angle="radian" autolimits="false"/><option timestep="{DT}" gravity="0 0 0" cone="elliptic" '
        f'jacobian="dense" solver="Newton" tolerance="1e-15" iterations="{ITERATIONS}" ls_iterations="100"/><default>'
        f'<geom contype="0" conaffinity="0" mass="0"/><pair {solver}/></default><worldbody>{tree}</worldbody>'
        f"<contact>{pairs}</contact></mujoco>"
    )


def _arm(name, arm, scene, hand):
    """Return the MJCF of an arm by the plant's own reading of the URDF, which is not the controller's."""
    description = arm_description(FR3)
    armature = joint_inertia(scene.reflected)
    xml, closing = f'<body pos="{_text(arm.base_position)}" quat="{_text(arm.base_orientation_wxyz)}">', "</body>"
    for i, (link, T) in enumerate(zip(description.links[1:], description.T_parent_joint, strict=True)):
        inertia = link.inertia
        full = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        xml += (
            f'<body pos="{_text(T[:3, 3])}" quat="{_text(_quaternion(T[:3, :3]))}">'
            f'<joint name="{name}{i}" type="hinge" axis="0 0 1" armature="{float(armature[i])!r}"/>'
            f'<inertial pos="{_text(link.centre)}" mass="{link.mass!r}" fullinertia="{_text(full)}"/>'
        )
        closing += "</body>"
    pad, flange = scene.pad, description.flange_offset_z
    a, b, c = pad.size
    moments = [pad.mass / 12 * s for s in (b * b + c * c, a * a + c * c, a * a + b * b)]
    xml += (
        f'<body pos="0 0 {flange + pad.flange_to_face - c / 2!r}"><inertial pos="0 0 0" mass="{pad.mass!r}" '
        f'diaginertia="{_text(moments)}"/></body>{hand}'
    )
    return xml + closing


def _place(scene, name):
    """Return position and rotation of the body that a contact's geoms are written in: an arm's last joint, a box."""
    if name in scene.supports:
        return np.zeros(3), np.eye(3)
    if name in scene.objects:
        return np.array(scene.objects[name].position), _rotation(scene.objects[name])
    arm = scene.arms[name]
    w, *xyz = arm.base_orientation_wxyz
    rotation, position = Rotation.from_quat([*xyz, w]).as_matrix(), np.array(arm.base_position)
    for T, q in zip(arm_description(FR3).T_parent_joint, arm.q, strict=True):
        position = position + rotation @ T[:3, 3]
        rotation = rotation @ T[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, q]).as_matrix()
    return position, rotation


def _local(place, point, frame):
    position, rotation = place
    return f'pos="{_text(rotation.T @ (point - position))}" quat="{_text(_quaternion(rotation.T @ frame))}"'


def _rotation(box):
    w, *xyz = box.orientation_wxyz
    return Rotation.from_quat([*xyz, w]).as_matrix()


def _quaternion(rotation):
    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def _text(values):
    return " ".join(repr(float(value)) for value in values)
