"""The Franka Hand in the plant: it squeezes, holds, lifts, misses and lets go through contacts, as its commands say."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.errors import ConnectionLost, GripperFailed, NoGripper
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.hand import Hand, Order, Outcome
from sim_robot.hand_parameters import FrankaHand
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import Scene, load_scene
from tests.support.plant_object import object_pose

SCENE = Path(str(files("sim_robot") / "scenes" / "hand.toml"))
BLOCK_M = 0.05
NAN = float("nan")


def cell() -> SimulatedCell:
    """The cell with a hand on the left arm, the block between its fingers."""
    return simulated_cell("block", 0.0, seed=3, scene=SCENE)


def hand_of(cell: SimulatedCell) -> Hand:
    hand = cell.hands[0]
    assert hand is not None
    return hand


def carry_out(cell: SimulatedCell, order: Order, most_ms: int = 5000) -> Outcome:
    for _ in range(most_ms):
        if order.outcome is not None:
            return order.outcome
        cell.next_state()
    raise AssertionError(f"no outcome within {most_ms} ms")


def homed() -> tuple[SimulatedCell, Hand]:
    one = cell()
    hand = hand_of(one)
    assert carry_out(one, hand.homing()) is Outcome.SUCCESS
    return one, hand


def held() -> tuple[SimulatedCell, Hand]:
    one, hand = homed()
    assert carry_out(one, hand.grasp(BLOCK_M, 0.1, 30.0, 0.005, 0.005)) is Outcome.SUCCESS
    return one, hand


def test_homing_opens_the_fingers_and_finds_the_largest_width_at_its_speed() -> None:
    one = cell()
    hand = hand_of(one)
    assert (hand.width, hand.max_width) == (0.06, 0.0)
    assert carry_out(one, hand.homing()) is Outcome.SUCCESS
    assert one.plant.ticks == pytest.approx(400, abs=2)  # 20 mm at 50 mm/s
    assert (hand.width, hand.max_width) == pytest.approx((0.08, 0.08))


def test_before_homing_nothing_else_works() -> None:
    hand = hand_of(cell())
    assert hand.move(0.05, 0.1).outcome is Outcome.FAIL
    assert hand.move(0.0, 0.1).outcome is Outcome.FAIL
    assert hand.grasp(0.05, 0.1, 30.0, 0.005, 0.005).outcome is Outcome.FAIL


@pytest.mark.parametrize(("width", "speed"), [(-0.01, 0.1), (0.081, 0.1), (NAN, 0.1), (0.05, 0.0), (0.05, NAN)])
def test_a_move_that_is_impossible_fails_and_does_not_end_the_one_that_runs(width: float, speed: float) -> None:
    one, hand = homed()
    running = hand.move(0.06, 0.1)
    assert hand.move(width, speed).outcome is Outcome.FAIL
    assert carry_out(one, running) is Outcome.SUCCESS
    assert hand.width == pytest.approx(0.06, abs=1e-6)


@pytest.mark.parametrize(
    "values",
    [
        (0.09, 0.1, 30.0, 0.005, 0.005),
        (0.05, -0.1, 30.0, 0.005, 0.005),
        (0.05, 0.1, 0.0, 0.005, 0.005),
        (0.05, 0.1, NAN, 0.005, 0.005),
        (0.05, 0.1, 30.0, -0.001, 0.005),
        (0.05, 0.1, 30.0, 0.005, float("inf")),
    ],
)
def test_a_grasp_that_is_impossible_fails(values: tuple[float, float, float, float, float]) -> None:
    _, hand = homed()
    assert hand.grasp(*values).outcome is Outcome.FAIL
    assert not hand.busy


def test_a_speed_above_the_hands_is_the_hands() -> None:
    one, hand = homed()
    start = one.plant.ticks
    assert carry_out(one, hand.move(0.06, 10.0)) is Outcome.SUCCESS
    assert one.plant.ticks - start == pytest.approx(200, abs=2)  # 20 mm at 0.1 m/s


@pytest.mark.parametrize(("force", "felt"), [(5.0, 5.0), (30.0, 30.0), (60.0, 60.0), (200.0, 70.0)])
def test_a_grasp_squeezes_the_object_with_the_force_that_was_asked_for(force: float, felt: float) -> None:
    one, hand = homed()
    assert carry_out(one, hand.grasp(BLOCK_M, 0.1, force, 0.005, 0.005)) is Outcome.SUCCESS
    for _ in range(300):
        one.next_state()
    assert hand.felt() == pytest.approx((felt, felt), rel=0.05)
    assert hand.is_grasped
    assert hand.width == pytest.approx(BLOCK_M, abs=1e-3)


def lift(one: SimulatedCell) -> None:
    """Raise the arm by its second joint, 0.15 rad in 1 s, as its own position control would."""
    q = one.plant.data.qpos[:7].copy()
    for tick in range(1000):
        q[1] -= 0.15e-3
        one.plant.track(0, q, np.array([0.0, -0.15 if tick < 999 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        one.next_state()


def test_what_is_grasped_is_lifted_and_falls_when_the_hand_stops() -> None:
    one, hand = held()
    start = object_pose(one.plant)[0][2]
    lift(one)
    assert object_pose(one.plant)[0][2] - start > 0.05
    assert hand.is_grasped
    assert carry_out(one, hand.stop()) is Outcome.SUCCESS
    assert not hand.is_grasped
    for _ in range(600):
        one.next_state()
    assert object_pose(one.plant)[0][2] - start < 0.03


def test_what_is_between_fingers_that_do_not_press_stays_on_the_table() -> None:
    one, _ = homed()
    start = object_pose(one.plant)[0][2]
    lift(one)
    assert object_pose(one.plant)[0][2] == pytest.approx(start, abs=1e-3)


@pytest.mark.parametrize(("width", "inner", "outer"), [(0.03, 0.005, 0.005), (0.07, 0.005, 0.005), (0.05, 0.0, 0.0)])
def test_a_grasp_at_another_width_than_said_is_unsuccessful_and_lets_go(
    width: float, inner: float, outer: float
) -> None:
    one, hand = homed()
    assert carry_out(one, hand.grasp(width, 0.1, 30.0, inner, outer)) is Outcome.UNSUCCESSFUL
    assert hand.felt() == (0.0, 0.0)
    assert not hand.is_grasped


def test_wide_tolerances_take_whatever_is_there() -> None:
    one, hand = homed()
    assert carry_out(one, hand.grasp(0.03, 0.1, 30.0, 0.005, 0.03)) is Outcome.SUCCESS


def test_a_grasp_of_nothing_closes_and_is_unsuccessful() -> None:
    one = simulated_cell("none", 0.0, seed=3, scene=SCENE)
    hand = hand_of(one)
    carry_out(one, hand.homing())
    order = hand.grasp(BLOCK_M, 0.1, 30.0, 0.005, 0.005)
    lowest = 1.0
    while order.outcome is None:
        one.next_state()
        lowest = min(lowest, hand.width)
    assert order.outcome is Outcome.UNSUCCESSFUL
    assert lowest == 0.0


def test_a_second_grasp_of_what_is_held_is_unsuccessful_and_lets_go() -> None:
    """As users of the robot report: libfranka, issue 108."""
    one, hand = held()
    assert carry_out(one, hand.grasp(BLOCK_M, 0.1, 10.0, 0.005, 0.005)) is Outcome.UNSUCCESSFUL
    assert not hand.is_grasped


def test_what_is_pulled_out_is_not_grasped_any_more() -> None:
    one, hand = held()
    one.plant.data.qpos[14:17] = (3.0, 0.0, 0.1)
    for _ in range(600):
        one.next_state()
    assert hand.width == 0.0
    assert not hand.is_grasped


def test_stop_aborts_a_move_where_it_is() -> None:
    one, hand = homed()
    order = hand.move(0.06, 0.1)
    for _ in range(100):
        one.next_state()
    assert hand.stop().outcome is Outcome.SUCCESS
    assert order.outcome is Outcome.ABORTED
    assert hand.width == pytest.approx(0.07, abs=2e-4)
    assert not hand.busy


def test_a_new_command_aborts_the_one_that_runs() -> None:
    one, hand = homed()
    first = hand.move(0.06, 0.1)
    one.next_state()
    second = hand.move(0.079, 0.1)
    assert first.outcome is Outcome.ABORTED
    assert carry_out(one, second) is Outcome.SUCCESS


def test_a_blocked_move_runs_until_its_time_is_over_and_lets_go() -> None:
    scene = load_scene(SCENE)
    quick = replace(scene, left=replace(scene.left, hand=FrankaHand(move_timeout_s=0.8)))
    parameters = load_plant_parameters()
    one = SimulatedCell(Plant(quick, parameters, "block", 0.0, 3), quick, parameters, seed=3)
    hand = hand_of(one)
    carry_out(one, hand.homing())
    order = hand.move(0.02, 0.1)
    for _ in range(700):
        one.next_state()
    assert order.outcome is None
    assert hand.felt() == pytest.approx((70.0, 70.0), rel=0.05)
    assert carry_out(one, order) is Outcome.UNSUCCESSFUL
    assert hand.felt() == (0.0, 0.0)


def test_the_same_commands_give_the_same_bytes() -> None:
    states = []
    for _ in range(2):
        one, hand = held()
        states.append((one.states.tobytes(), hand.width, one.plant.ticks))
    assert states[0] == states[1]


def test_the_arm_carries_the_hand() -> None:
    """The hand's weight is in the arm's gravity torques: nothing moves, and nothing is felt from outside."""
    one = cell()
    for _ in range(500):
        one.next_state()
    assert np.abs(one.plant.data.qvel[:14]).max() < 1e-3
    bodies = one.plant.model.body
    assert bodies("left_hand").mass[0] == 0.73
    # what hangs on link 7, without and with the hand
    hanging = one.plant.model.body_subtreemass
    assert hanging[bodies("left_link7").id] - bodies("left_link7").mass[0] == pytest.approx(0.73)
    assert one.states["O_T_EE"][0, :3, 3] == pytest.approx((0.4, -0.5, 0.27), abs=2e-3)  # in the arm's base


def test_a_scene_without_a_hand_is_the_same_model_as_ever() -> None:
    one = simulated_cell("rice_box", 0.0, seed=3)
    assert one.hands == (None, None)
    model = one.plant.model
    names = [model.body(index).name for index in range(model.nbody)]
    assert not [name for name in names if "hand" in name or "finger" in name]
    assert model.nv == 20


def written(tmp_path: Path, table: str) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text(SCENE.read_text().replace("[left.hand]\n", f"[left.hand]\n{table}\n"))
    return path


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("max_speed = 0.0", "key left.hand.max_speed: Input should be greater than 0"),
        ("start_width = 0.09", "start_width must not exceed max_width, 0.08, got 0.09"),
        ("strength = 3.0", "hand.strength: Unexpected keyword"),
        ("inertia = [0.0, 1.0, 1.0]", "hand.inertia.0: Input should be greater than 0"),
    ],
)
def test_a_hand_that_is_none_is_refused_by_its_key(tmp_path: Path, table: str, complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        load_scene(written(tmp_path, table))


def test_a_hand_on_either_arm(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(SCENE.read_text().replace("[left.hand]", "[right.hand]"))
    scene: Scene = load_scene(path)
    assert (scene.left.hand, scene.right.hand) == (None, FrankaHand())
    plant = Plant.nominal(load_scene(SCENE), load_plant_parameters(), "block")
    assert [len(bodies) for bodies in plant.finger_bodies] == [2, 0]


def test_the_gripper_of_a_cell_in_one_process() -> None:
    """hal's contract: the cell's time goes on while a command runs."""
    one = cell()
    gripper = one.gripper(0)
    with pytest.raises(GripperFailed, match="homed"):
        gripper.move(0.05, 0.1)
    assert gripper.homing()
    assert gripper.grasp(BLOCK_M, 0.1, 30.0)
    state = gripper.state()
    assert (state.is_grasped, state.max_width, state.t_ns) == (True, pytest.approx(0.08), one.plant.ticks * 1_000_000)
    assert gripper.stop()
    assert not gripper.grasp(0.02, 0.1, 30.0)
    gripper.close()
    with pytest.raises(ConnectionLost, match="closed"):
        gripper.state()
    with pytest.raises(NoGripper, match="right arm has no hand"):
        one.gripper(1)


def test_in_one_process_a_hand_does_not_move_while_an_arm_is_controlled() -> None:
    one = cell()
    one.right.read()
    one.right.write(np.zeros(7))
    one.right.read()
    with pytest.raises(GripperFailed, match="stop them"):
        one.gripper(0).homing()
