"""The map from arrays: outcomes known by hand, and what is refused in one line."""

import mujoco
import numpy as np
import pytest

from rtstack.impact_map import (
    ContactState,
    SceneError,
    Status,
    converged,
    frame_of,
    problem_from_arrays,
    problem_from_mujoco,
    problem_from_urdf,
    problem_of,
    single_step,
)
from tests.support.impact_map.models import MODELS, mjcf, urdf
from tests.support.impact_map.scenes import random_scene

BALL = {"M": 2.0 * np.eye(3), "J": np.eye(3), "velocity": np.array([1.0, 0.0, -1.0]), "friction": 0.3}


def test_a_ball_that_falls_slides_on_with_what_friction_leaves_it():
    impact = single_step(problem_from_arrays(**BALL))
    np.testing.assert_allclose(impact.velocity, [0.7, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(impact.impulses, [[-0.6, 0.0, 2.0]], atol=1e-12)
    assert impact.states == (ContactState.SLIDING,)
    assert (impact.status, impact.law.worst < 1e-9) == (Status.SOLVED, True)


def test_frames_turn_what_is_along_the_worlds_axes():
    wall = np.array([1.0, 2.0, 2.0]) / 3.0
    frame = frame_of(wall)
    speed = frame @ np.array([1.0, 0.0, -1.0])
    impact = single_step(problem_from_arrays(2.0 * np.eye(3), np.eye(3), speed, 0.3, frames=[frame]))
    np.testing.assert_allclose(impact.velocity, frame @ [0.7, 0.0, 0.0], atol=1e-12)
    moving = problem_from_arrays(np.eye(3), np.eye(3), np.zeros(3), 0.0, frames=[frame], support_velocity=[0.5 * wall])
    np.testing.assert_allclose(single_step(moving).velocity, 0.5 * wall, atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_arrays_of_a_scene_give_the_bits_of_the_scene(seed):
    scene = problem_of(random_scene(seed))
    held = np.zeros(len(scene.friction), bool)
    for k in scene.maintained():
        held[scene.points[k]] = True
    labels = [k for k, rows in enumerate(scene.points) for _ in range(rows.start, rows.stop)]
    problem = problem_from_arrays(
        scene.M, scene.J, scene.velocity, scene.friction, support_velocity=scene.s.reshape(-1, 3), patches=labels,
        maintained=held,
    )  # fmt: skip
    for way in (single_step, converged):
        one, other = way(scene), way(problem)
        np.testing.assert_array_equal(one.velocity, other.velocity)
        np.testing.assert_array_equal(one.pressing_ns, other.pressing_ns)


def test_a_patch_that_would_have_to_pull_names_itself():
    away = problem_from_arrays(np.eye(3), np.eye(3), [0.0, 0.0, 1.0], 0.5, patches=["pad"], maintained=True)
    impact = converged(away)
    assert impact.status is Status.INFEASIBLE
    assert "the second of patch pad part" in impact.detail


def test_labels_may_be_any_sequence():
    swapped = memoryview(np.array([1], ">i8"))
    for labels in (["pad"], (("left", "box"),), np.array([3]), swapped):
        assert single_step(problem_from_arrays(**BALL, patches=labels)).status is Status.SOLVED


def test_a_support_that_comes_against_what_cannot_move_along_it_leaves_no_room():
    problem = problem_from_arrays(np.eye(1), np.zeros((3, 1)), [1.0], 0.0, support_velocity=[[0.0, 0.0, 1.0]])
    assert single_step(problem).status is Status.INFEASIBLE


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"M": np.eye(2)}, r"J: expected shape \(3, 2\), found \(3, 3\)"),
        ({"M": np.ones((3, 2))}, r"M: expected shape \(3, 3\), found \(3, 2\)"),
        ({"M": np.diag([1.0, 1.0, 0.0])}, "M: expected a positive definite matrix"),
        ({"M": np.diag([1.0, 1.0, -1.0])}, "M: expected a positive definite matrix"),
        ({"M": np.eye(3) + np.diag([0.1, 0.0], 1)}, "M: expected a symmetric matrix, found differences of 0.1"),
        ({"M": np.full((3, 3), np.nan)}, "M: expected finite numbers, found nan"),
        ({"M": 1e-300 * np.eye(3), "J": 1e10 * np.eye(3)}, "beyond what a float holds"),
        ({"M": np.zeros((0, 0))}, "J: expected three rows"),
        ({"J": np.eye(3)[:2]}, r"J: expected three rows for each of 1 to 1000 points, found \(2, 3\)"),
        ({"J": np.zeros((0, 3))}, "J: expected three rows"),
        ({"J": np.zeros((3003, 3))}, "J: expected three rows"),
        ({"J": "a"}, "J: expected numbers, found <U1"),
        ({"velocity": np.zeros(2)}, r"velocity: expected shape \(3,\), found \(2,\)"),
        ({"velocity": [1j, 0.0, 0.0]}, "velocity: expected numbers, found complex128"),
        ({"friction": -0.1}, "friction: expected at least 0, found -0.1"),
        ({"friction": [0.1, 0.2]}, r"friction: expected shape \(1,\), found \(2,\)"),
        ({"friction": np.inf}, "friction: expected finite numbers, found inf"),
        ({"friction": True}, "friction: expected numbers, found bool"),
        ({"frames": [2.0 * np.eye(3)]}, "frames: expected rotations"),
        ({"frames": np.eye(3)}, r"frames: expected shape \(1, 3, 3\), found \(3, 3\)"),
        ({"support_velocity": np.zeros(3)}, r"support_velocity: expected shape \(1, 3\), found \(3,\)"),
        ({"patches": [0, 1]}, "patches: expected a label for each of 1 points, found 2"),
        ({"maintained": [1]}, "maintained: expected true or false, found int64"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(change, message):
    with pytest.raises(ValueError, match=message) as raised:
        problem_from_arrays(**(BALL | change))
    assert "\n" not in str(raised.value)


def test_models_are_refused_in_one_line(tmp_path):
    links, q = MODELS["planar 2R"]
    model = mujoco.MjModel.from_xml_string(mjcf(links, '<geom name="floor" type="plane" size="1 1 1" pos="0 0 -9"/>'))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(links))
    good = (file, q, (0.0, 0.0), ["tip"], [(0.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)], 0.5)
    problem_from_urdf(*good)
    for call, error, message in (
        (lambda: problem_from_mujoco(model, data), SceneError, "found none among 0"),
        (lambda: problem_from_mujoco(model, data, [("tip", "flor")]), SceneError, "pairs: Invalid name 'flor'"),
        (lambda: problem_from_mujoco(model, None), TypeError, "found MjModel and NoneType"),
        (lambda: problem_from_urdf(tmp_path / "no.urdf", *good[1:]), SceneError, "not a URDF that Pinocchio reads"),
        (lambda: problem_from_urdf(file, q[:1], *good[2:]), ValueError, r"q: expected shape \(2,\), found \(1,\)"),
        (lambda: problem_from_urdf(*good[:3], ["hand"], *good[4:]), SceneError, "found 'hand'"),
        (lambda: problem_from_urdf(*good[:5], [(0.0, 0.0, 0.0)], 0.5), ValueError, "normals: expected directions"),
        (lambda: problem_from_urdf(*good, armature=[1.0]), ValueError, r"armature: expected shape \(2,\)"),
    ):
        with pytest.raises(error, match=message) as raised:
            call()
        assert "\n" not in str(raised.value)
