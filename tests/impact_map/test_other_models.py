"""Ten robots of other people that hit a wall and push a box: the map against ways that share nothing with it."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from rtstack.impact_map import ContactState, Status, problem_from_mujoco, problem_from_urdf, single_step
from tests.support.impact_map.cone import cone_velocity
from tests.support.impact_map.models import DT, MODELS, TIP, mjcf, urdf

DEPTH = 1e-9  # m: what makes geoms touch
HALF, MASS = np.array([0.05, 0.06, 0.04]), 0.8  # of the box
TOWARDS = np.array([-1.0, 0.1, -0.2])  # of the tip's velocity, m/s
WALL = np.array([1.0, 0.2, 0.4]) / np.linalg.norm([1.0, 0.2, 0.4])


def tip_of(links, q):
    """Return the tip's position (3,) and its Jacobian (3, n) by Pinocchio, the latter by differences."""
    model = pin.buildModelFromXML(urdf(links))
    data = model.createData()

    def place(at):
        pin.framesForwardKinematics(model, data, at)
        return data.oMf[model.getFrameId("tip")].translation.copy()

    step = 1e-6 * np.eye(len(q))
    J = np.column_stack([(place(q + d) - place(q - d)) / 2e-6 for d in step])
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T + np.diag([link.armature for link in links])
    return place(q), J, M


def state_of(links, q, surroundings, friction, box=None):
    """Return MuJoCo's model and data, in contact, with the tip moving towards what it hits."""
    model = mujoco.MjModel.from_xml_string(mjcf(links, surroundings, friction))
    data = mujoco.MjData(model)
    _, J, _ = tip_of(links, q)
    data.qpos[: len(q)], data.qvel[: len(q)] = q, np.linalg.pinv(J) @ TOWARDS + 0.1 * np.cos(np.arange(len(q)))
    if box is not None:
        data.qpos[len(q) : len(q) + 3] = box
    mujoco.mj_forward(model, data)
    return model, data


def wall(links, q, friction):
    place = tip_of(links, q)[0] - (TIP - DEPTH) * WALL
    text = " ".join(map(repr, map(float, place))), " ".join(map(repr, map(float, WALL)))
    return state_of(
        links, q, f'<geom name="wall" type="plane" size="1 1 1" pos="{text[0]}" zaxis="{text[1]}"/>', friction
    )


def stepped(model, data):
    """Return the velocity after one very short step of MuJoCo, stiffer than its own idea of the bodies' inertia."""
    model.body_invweight0[:] *= 0.01
    mujoco.mj_forward(model, data)
    data.qvel -= DT * data.qacc_smooth
    mujoco.mj_step(model, data)
    return data.qvel.copy()


@pytest.mark.parametrize("name", MODELS)
def test_a_tip_that_hits_a_wall(name, tmp_path):
    links, q = MODELS[name][0], np.array(MODELS[name][1])
    _, J, M = tip_of(links, q)
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(links))
    for friction in (0.0, 0.15, 0.6, 0.9):  # with more the oracle does not come to an end for the SCARA
        model, data = wall(links, q, friction)
        before = data.qvel.copy()
        problem = problem_from_mujoco(model, data)
        impact = single_step(problem)
        assert impact.status is Status.SOLVED
        assert problem.friction == pytest.approx(max(friction, 1e-5))  # MuJoCo's least
        frame = data.contact[0].frame.reshape(3, 3)[[1, 2, 0]]
        # the point that touches, at -TIP along the normal, turns with the last link: w x r is added
        rim = J - pin.skew(-TIP * WALL) @ _turning(links, q)
        oracle = cone_velocity(M, frame @ rim, before, problem.friction, np.zeros(3))
        scale = np.abs(oracle - before).max()
        assert np.abs(impact.velocity - oracle).max() < 1e-7 * scale
        local = _rotation(links, q).T @ (-TIP * WALL)
        by_urdf = problem_from_urdf(
            file, q, before, ["tip"], [local], [WALL], problem.friction, armature=[link.armature for link in links]
        )
        np.testing.assert_allclose(by_urdf.M, problem.M, atol=1e-12)
        assert np.abs(single_step(by_urdf).velocity - impact.velocity).max() < 1e-7 * scale
        print(f"{name} {friction}: {np.abs(impact.velocity - oracle).max() / scale:.1e}")
        if impact.states[0] is ContactState.STICKING or friction == 0.0:  # where MuJoCo's law is the same
            assert np.abs(stepped(model, data) - impact.velocity).max() < 2e-3 * scale


@pytest.mark.parametrize("name", MODELS)
def test_a_tip_that_pushes_a_box_on_the_floor(name):
    links, q, n = MODELS[name][0], np.array(MODELS[name][1]), len(MODELS[name][1])
    tip, J, M = tip_of(links, q)
    centre = tip - np.array([TIP + HALF[0] - DEPTH, 0.01, -0.01])
    size = " ".join(map(str, HALF))
    surroundings = (
        f'<geom name="floor" type="plane" size="9 9 1" pos="0 0 {float(centre[2] - HALF[2] + DEPTH)!r}"/>'
        f'<body name="box"><freejoint/><geom name="box" type="box" size="{size}" mass="{MASS}"/></body>'
    )
    for friction in (0.0, 0.3, 0.9):
        model, data = state_of(links, q, surroundings, friction, centre)
        before = data.qvel.copy()
        problem = problem_from_mujoco(model, data)
        impact = single_step(problem)
        assert len(problem.friction) == 5 + sum(c.geom.tolist() == [0, 1] for c in data.contact)
        whole = np.zeros((n + 6, n + 6))
        whole[:n, :n], whole[n : n + 3, n : n + 3] = M, MASS * np.eye(3)
        whole[n + 3 :, n + 3 :] = np.diag(MASS / 3.0 * (HALF @ HALF - HALF**2))
        rows, names = [], [model.geom(k).name for k in range(model.ngeom)]
        for contact in data.contact:
            moving = {"floor": np.zeros((3, n + 6)), "box": np.zeros((3, n + 6)), "tip": np.zeros((3, n + 6))}
            moving["box"][:, n:] = np.hstack([np.eye(3), -pin.skew(contact.pos - centre)])
            moving["tip"][:, :n] = J - pin.skew(contact.pos - tip) @ _turning(links, q)
            first, second = (names[k] for k in contact.geom[::-1])
            rows.append(contact.frame.reshape(3, 3)[[1, 2, 0]] @ (moving[first] - moving[second]))
        oracle = cone_velocity(whole, np.vstack(rows), before, problem.friction, np.zeros(3 * len(rows)))
        scale = np.abs(oracle - before).max()
        assert impact.status in (Status.SOLVED, Status.NOT_UNIQUE)
        if impact.status is Status.SOLVED:
            assert np.abs(impact.velocity - oracle).max() < 1e-6 * scale
        assert impact.law.worst < 1e-9
        print(f"{name} {friction} {impact.status.value}: {np.abs(impact.velocity - oracle).max() / scale:.1e}")


def test_a_problem_stays_when_the_simulation_goes_on():
    links, q = MODELS["planar 2R"][0], np.array(MODELS["planar 2R"][1])
    model, data = wall(links, q, 0.3)
    problem = problem_from_mujoco(model, data)
    before = single_step(problem)
    mujoco.mj_step(model, data)
    after = single_step(problem)
    np.testing.assert_array_equal(problem.velocity, problem_from_mujoco(*wall(links, q, 0.3)).velocity)
    assert after.momentum_ns == before.momentum_ns


def _rotation(links, q):
    model = pin.buildModelFromXML(urdf(links))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("tip")].rotation.copy()


def _turning(links, q):
    """Return the Jacobian (3, n) of the last link's angular velocity along the world's axes, by hand."""
    turn, columns = np.eye(3), []
    for link, angle in zip(links, q, strict=True):
        columns.append(turn @ link.axis)
        turn = turn @ pin.exp3(np.array(link.axis) * angle)
    return np.column_stack(columns)
