"""Impacts whose outcome is known by hand, and the cases that have no answer or more than one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rtstack.impact_map import (
    Arm,
    Box,
    Contact,
    ContactState,
    Plane,
    ReflectedInertia,
    Scene,
    SceneError,
    Status,
    converged,
    impact_map,
    load_scene,
    pressed,
    problem_of,
    single_step,
)
from rtstack.impact_map.bodies import arm_body
from rtstack.impact_map.patch import Face, face_on_face
from rtstack.impact_map.scene import DEFAULT_PAD
from tests.support.impact_map.scenes import LEFT_Q, MIRROR

IMPACTS = Path(__file__).resolve().parents[2] / "deploy" / "impacts"
GRAB = load_scene(IMPACTS / "grab.toml")
TABLE = Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
ON_TABLE = Contact(("box", "table"), 0.5)


def box(**values):
    """A cube of 1 kg and 0.2 m on the table."""
    return Box(**{"mass": 1.0, "size": (0.2, 0.2, 0.2), "position": (0.0, 0.0, 0.1), **values})


def on_table(cube, friction=0.5):
    return Scene(contacts=(Contact(("box", "table"), friction),), objects={"box": cube}, supports={"table": TABLE})


def test_a_box_that_falls_flat_stays_on_the_table():
    result = impact_map(on_table(box(velocity=(0.0, 0.0, -2.0))))
    assert result.single_step.status is Status.SOLVED
    np.testing.assert_allclose(result.twist("box"), 0.0, atol=1e-12)
    np.testing.assert_allclose(result.single_step.impulses[:, 2].sum(), 2.0, atol=1e-12)
    np.testing.assert_allclose(result.single_step.impulses[:, 2], 0.5, atol=1e-6)  # the even ones
    assert not result.single_step.impulses_unique
    assert result.single_step.kinetic_energy_after_j == pytest.approx(0.0, abs=1e-12)


def test_a_falling_cube_slides_on_with_what_friction_leaves_it():
    # the impulse of 1 Ns passes under the centre: it would tip over, if its edge did not carry it: v = 1 - mu * 1
    flat = box(size=(1.0, 1.0, 0.01), position=(0.0, 0.0, 0.005), velocity=(1.0, 0.0, -1.0))
    result = impact_map(on_table(flat, friction=0.3))
    np.testing.assert_allclose(result.twist("box"), [0.7, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    assert set(result.single_step.states) == {ContactState.SLIDING}


def test_a_corner_that_hits_turns_the_box():
    # a thin plate's corner at r from the centre, frictionless: lambda = -v_N / (1/m + r^2/I) along z
    plate = box(size=(0.2, 0.2, 0.2), velocity=(0.0, 0.0, -1.0))
    scene = Scene(
        contacts=(Contact(("box", "table"), 0.0, points=((0.1, 0.0, 0.0),), normal=(0.0, 0.0, 1.0)),),
        objects={"box": plate},
        supports={"table": TABLE},
    )
    impulse = 1.0 / (1.0 + 0.1**2 / (1.0 / 6.0 * 0.04))
    after = impact_map(scene).twist("box")
    np.testing.assert_allclose(after, [0.0, 0.0, impulse - 1.0, 0.0, -0.1 * impulse / (0.04 / 6.0), 0.0], atol=1e-12)


def test_what_rests_stays_at_rest_and_what_parts_is_left_alone():
    assert impact_map(on_table(box())).single_step.kinetic_energy_after_j == 0.0
    lifted = impact_map(on_table(box(velocity=(0.0, 0.0, 1.0))))
    np.testing.assert_allclose(lifted.twist("box"), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], atol=0.0)
    assert set(lifted.single_step.states) == {ContactState.OPEN}


def test_a_conveyor_takes_the_box_along_only_as_friction_allows():
    moving = replace(TABLE, velocity=(1.0, 0.0, 0.0))
    flat = box(size=(1.0, 1.0, 0.01), position=(0.0, 0.0, 0.005), velocity=(0.0, 0.0, -1.0))
    scene = Scene(contacts=(Contact(("box", "table"), 0.3),), objects={"box": flat}, supports={"table": moving})
    np.testing.assert_allclose(impact_map(scene).twist("box")[0], 0.3, atol=1e-9)


def test_a_box_that_is_pressed_on_a_moving_support_moves_with_it():
    moving = replace(TABLE, velocity=(0.5, 0.0, 0.2))
    held = Contact(("box", "table"), 0.1, maintained=True)
    scene = Scene(contacts=(held,), objects={"box": box()}, supports={"table": moving})
    np.testing.assert_allclose(impact_map(scene).twist("box"), [0.5, 0.0, 0.2, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_press_that_leaves_no_room_is_infeasible():
    lid = Plane(point=(0.0, 0.0, 0.2), normal=(0.0, 0.0, -1.0), velocity=(0.0, 0.0, -0.1))
    scene = Scene(
        contacts=(ON_TABLE, Contact(("box", "lid"), 0.5)), objects={"box": box()}, supports={"table": TABLE, "lid": lid}
    )
    result = impact_map(scene)
    assert result.single_step.status is Status.INFEASIBLE
    assert "no room" in result.single_step.detail


def test_a_patch_that_would_have_to_pull_is_infeasible():
    away = replace(
        GRAB, arms={**GRAB.arms, "left": replace(GRAB.arms["left"], pad_twist=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0))}
    )
    result = impact_map(away)
    assert result.converged.status is Status.INFEASIBLE
    assert "left and rice_box part" in result.converged.detail
    assert result.single_step.status is not Status.INFEASIBLE


def test_loads_that_decide_over_the_slip_are_reported_and_even_ones_told():
    # a box that turns while it falls flat: its four corners slide in different directions
    spinning = box(size=(0.3, 0.1, 0.05), position=(0.0, 0.0, 0.025), velocity=(0.4, 0.0, -1.0),
                   angular_velocity=(0.0, 0.0, 8.0))  # fmt: skip
    impact = impact_map(on_table(spinning, friction=0.2)).single_step
    assert impact.status is Status.NOT_UNIQUE
    assert "redundant contacts" in impact.detail
    assert impact.spread_m_s > 1e-6
    assert impact.second_opinion_m_s < 1e-6


def test_without_a_second_opinion_the_result_is_the_same_and_says_so():
    problem = problem_of(GRAB)
    alone, both = single_step(problem, second_opinion=False), single_step(problem)
    np.testing.assert_array_equal(alone.velocity, both.velocity)
    assert alone.second_opinion_m_s is None
    assert alone.detail.startswith("unconfirmed")
    assert both.detail == "confirmed by PGS"


class TestConverged:
    """The map of the end of the sequence, for a grab."""

    def test_pads_neither_leave_the_box_nor_slip_and_the_table_does_not_pull(self):
        result = impact_map(GRAB)
        pads = result.converged.velocities[:8]
        assert np.abs(pads).max() < 1e-12
        assert result.single_step.velocities[:8, 2].max() > 1e-3  # which the single step does not give
        assert np.all(result.converged.impulses[8:, 2] >= 0.0)
        assert np.all(result.converged.velocities[8:, 2] >= -1e-12)

    def test_it_is_the_single_step_under_the_pressing_that_it_tells(self):
        problem = problem_of(GRAB)
        end = converged(problem)
        assert end.pressing_ns[0] > 0.0
        np.testing.assert_allclose(pressed(problem, end.pressing_ns * 1.01).velocity, end.velocity, atol=1e-9)
        assert np.abs(pressed(problem, end.pressing_ns * 0.05).velocity - end.velocity).max() > 1e-4

    def test_more_pressing_changes_nothing(self):
        problem = problem_of(GRAB)
        end = converged(problem)
        np.testing.assert_allclose(pressed(problem, end.pressing_ns * 3.0).velocity, end.velocity, atol=1e-9)

    def test_without_friction_pads_slip_but_stay_closed(self):
        scene = replace(GRAB, contacts=tuple(replace(contact, friction=0.0) for contact in GRAB.contacts))
        end = impact_map(scene).converged
        assert np.abs(end.velocities[:8, 2]).max() < 1e-12
        assert np.abs(end.velocities[:8, :2]).max() > 0.1

    def test_a_patch_that_nobody_presses_is_left_to_the_law(self):
        scene = replace(GRAB, contacts=tuple(replace(contact, maintained=False) for contact in GRAB.contacts))
        result = impact_map(scene)
        np.testing.assert_array_equal(result.converged.velocity, result.single_step.velocity)


@pytest.mark.parametrize("kind", list(ReflectedInertia))
def test_reflected_inertia_is_added_to_the_joints(kind):
    table_i = {"B_theta": [0.2, 0.2, 0.15, 0.15, 0.067, 0.067, 0.067], "B": [0.6, 0.6, 0.45, 0.45, 0.2, 0.2, 0.2]}
    added = np.diag(table_i.get(kind.value, np.zeros(7)))
    arm = GRAB.arms["left"]
    bare = arm_body(arm, DEFAULT_PAD, ReflectedInertia.NONE)[0].M
    np.testing.assert_allclose(arm_body(arm, DEFAULT_PAD, kind)[0].M, bare + added, atol=1e-15)


def test_more_inertia_of_the_motors_makes_the_box_faster():
    speeds = [impact_map(replace(load_scene(IMPACTS / "hit_and_push.toml"), reflected=kind)).twist("box_130")[1]
              for kind in ("none", "B_theta", "B")]  # fmt: skip
    assert speeds[0] > speeds[1] > speeds[2]
    assert speeds[2] < 0.0


def test_a_pad_over_an_edge_touches_where_they_overlap():
    first = Face(np.array([0.1, 0.0, 0.0]), np.diag([1.0, -1.0, -1.0]), np.array([0.05, 0.05]))
    second = Face(np.zeros(3), np.eye(3), np.array([0.1, 0.2]))
    patch = face_on_face(first, second)
    assert patch is not None
    expected = {(0.05, -0.05), (0.05, 0.05), (0.1, -0.05), (0.1, 0.05)}
    assert {(round(x, 9), round(y, 9)) for x, y, _ in patch.points} == expected
    assert face_on_face(replace(first, centre=np.array([0.16, 0.0, 0.0])), second) is None
    assert face_on_face(replace(first, centre=np.array([0.0, 0.0, 0.02])), second) is None
    assert face_on_face(replace(first, axes=np.eye(3)), second) is None


def test_arms_may_give_joint_velocities_and_mirrored_arms_are_mirrored():
    left = Arm((-0.4, 0.5, 0.0), tuple(LEFT_Q), dq=(0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    right = Arm((-0.4, -0.5, 0.0), tuple(LEFT_Q * MIRROR), dq=(-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    twists = []
    for arm in (left, right):
        body = arm_body(arm, DEFAULT_PAD, ReflectedInertia.NONE)[0]
        np.testing.assert_array_equal(body.velocity, arm.dq)
        twists.append(body.twist(body.velocity))
    np.testing.assert_allclose(twists[0], twists[1] * [1, -1, 1, -1, 1, -1], atol=1e-12)


BAD = {
    "q = [": ("q = [0.0, ", "arms.left.q"),
    "mass = 1.25": ("mass = -1.0", "objects.rice_box.mass"),
    "friction = 0.4": ("friction = -0.1", "contacts.2.friction"),
    'between = ["left", "rice_box"]': ('between = ["left", "nobody"]', "contacts.0.between"),
    "position = [0.0, 0.0, 0.3]": ("position = [0.0, 0.3, 0.3]", "contacts.0: left does not touch rice_box"),
    "normal = [0.0, 0.0, 1.0]": ("normal = [0.0, 0.0, 0.0]", "supports.table.normal"),
    'reflected = "B_theta"': ('reflected = "C"', "reflected"),
    "size = [0.2, 0.3, 0.2]": ("size = [0.2, 0.3, inf]", "objects.rice_box.size"),
    "[supports.table]": ("[supports.left]", "arms has a body of that name"),
}


@pytest.mark.parametrize("good", BAD)
def test_a_bad_scene_is_one_line(good, tmp_path):
    bad, problem = BAD[good]
    text = (IMPACTS / "grab.toml").read_text()
    assert good in text
    path = tmp_path / "scene.toml"
    path.write_text(text.replace(good, bad, 1))
    with pytest.raises(
        SceneError if problem.startswith(("contacts.0", "supports", "arms has")) else Exception
    ) as raised:
        impact_map(load_scene(path))
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


def test_the_command_line_prints_maps_and_refuses_bad_input(tmp_path, command_line):
    import json

    done = command_line("impact-map", str(IMPACTS / "grab.toml"), "--reflected", "B", "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    expected = impact_map(replace(GRAB, reflected=ReflectedInertia.B))
    np.testing.assert_allclose(printed["converged"]["bodies"]["left"]["twist"], expected.twist("left"), atol=1e-12)
    assert printed["reflected"] == "B"
    apart = tmp_path / "apart.toml"
    apart.write_text(
        (IMPACTS / "grab.toml").read_text().replace("position = [0.0, 0.0, 0.3]", "position = [0, 1, 0.3]")
    )
    refused = command_line("impact-map", str(apart))
    assert refused.returncode == 2
    assert refused.stdout == ""
    assert refused.stderr.count("\n") == 1
    assert "does not touch" in refused.stderr
