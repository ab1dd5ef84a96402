"""Every fault: its name, that it is reported within two cycles of its condition, and its recovery.

Counted in message ids, read from the bytes. After each, a recovery with the real client and a motion.
"""

import socket
from collections.abc import Callable

import mujoco
import numpy as np
import pylibfranka as franka
import pytest

from hal.robots import FR3
from hal.state import RobotMode
from sim_robot.cell import simulated_cell
from sim_robot.fci.protocol import Command, Controller, Generator, MoveStatus
from sim_robot.model import PROXIMITY_M
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import SIDES, load_scene
from tests.support.fci.client import connect, go_home, hold, move_to, smooth, torque_control
from tests.support.fci.motions import assert_stopped_and_recover, held, names
from tests.support.fci.raw import RawClient, arriving, errors_of
from tests.support.fci.server import Served

CYCLES = 2
WARM_UP = 20
FIRST_ANSWERS = 4
TORQUES = (Controller.EXTERNAL, Generator.NONE)
POSITIONS = (Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION)
VELOCITIES = (Controller.JOINT_IMPEDANCE, Generator.JOINT_VELOCITY)
Kind = tuple[Controller, Generator]
# the fields of the answer to the state of this tick; None: no answer
Law = Callable[[int, np.void], dict | None]


def begin(raw: RawClient, kind: Kind) -> None:
    raw.connect()
    assert raw.move(*kind) == MoveStatus.MOTION_STARTED


def read(raw: RawClient, count: int) -> np.void:
    """The next state; at the beginning the newest one, because a robot that waits repeats itself."""
    return raw.state() if count < WARM_UP else raw.next_state()


def hang_up(raw: RawClient) -> None:
    """Leave, and wait until the server has let go of this client."""
    raw.tcp.shutdown(socket.SHUT_WR)
    while raw.tcp.recv(4096):
        continue


def until_reflex(raw: RawClient, law: Law, most: int, kind: Kind = TORQUES) -> list[np.void]:
    """Answer each state with law(tick, state), or not at all, until one shows a reflex; every state, oldest first."""
    begin(raw, kind)
    states = [read(raw, 0)]
    while states[-1]["robot_mode"] != RobotMode.REFLEX:
        assert len(states) <= most, "no reflex"
        fields = law(len(states) - 1, states[-1])
        if fields is not None:
            raw.command(states[-1], **fields)
        states.append(read(raw, len(states)))
    if kind == TORQUES:
        command, _, body = raw.answer()
        assert (command, body[0]) == (Command.MOVE, MoveStatus.REFLEX_ABORTED)
    hang_up(raw)
    return states


def assert_recovers(address: str, side: str, ticks: int = 3000) -> None:
    """By a recovery, torque control and the way home, which takes so many ticks."""
    robot = connect(address)
    robot.automatic_error_recovery()
    state = robot.read_once()
    assert names(state.current_errors) == set()
    q_hold = np.array(state.q)
    torque_control(robot, 50, lambda tick, state: hold(state, q_hold))
    home = np.array(getattr(load_scene(), side).home)
    move_to(robot, home, ticks)
    assert np.abs(np.array(robot.read_once().q) - home).max() < 0.01


def reasons(state: np.void) -> set[str]:
    return errors_of(state, "reflex_reason")


def cycles_since(states: list[np.void], condition: Callable[[np.void], bool]) -> int:
    """Message ids from the first state that shows the condition to the one that shows the reflex."""
    first = next(state for state in states if condition(state))
    return int(states[-1]["message_id"]) - int(first["message_id"])


def cycles_since_answer(states: list[np.void], tick: int) -> int:
    """Message ids from the state whose answer was the fault to the one that shows the reflex."""
    return int(states[-1]["message_id"]) - int(states[tick]["message_id"])


def beyond(state: np.void) -> bool:
    """A joint outside its position limits."""
    return bool(np.any((state["q"] > FR3.limits.q_upper) | (state["q"] < FR3.limits.q_lower)))


def too_fast(state: np.void) -> bool:
    """A joint faster than the limit for its position allows."""
    spare = load_plant_parameters().reflexes.velocity_tolerance
    for sign, room in ((1.0, FR3.limits.q_upper - state["q"]), (-1.0, state["q"] - FR3.limits.q_lower)):
        braked = np.sqrt(2.0 * FR3.limits.deceleration * np.maximum(room, 0.0)) - FR3.limits.velocity_offset
        if np.any(sign * state["dq"] - spare > np.minimum(FR3.limits.dq_max, np.maximum(0.0, braked))):
            return True
    return False


def fail(robot: franka.Robot, ticks: int, law) -> None:
    with pytest.raises(franka.ControlException):
        torque_control(robot, ticks, law)


def test_a_recovery_is_answered_once_the_arm_stands(lockstep: Served) -> None:
    """A client that goes on at once, with a damping of its own, would otherwise begin in the middle of the braking."""
    with RawClient(lockstep.left) as raw:
        raw.connect()
        assert raw.move() == MoveStatus.MOTION_STARTED
        fastest = 0.0
        while (state := raw.state())["robot_mode"] != RobotMode.REFLEX:
            fastest = max(fastest, float(np.abs(state["dq"]).max()))
            raw.command(state, tau_J_d=-np.eye(7)[0] * min(abs(float(state["tau_J_d"][0])) + 0.9, 30.0))
        assert fastest > 1.0
        raw.answer()
        raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
        assert raw.answer()[2] == b"\0"
        raw.state()  # what has come meanwhile
        assert np.abs(raw.next_state()["dq"]).max() < 0.03


def test_a_reflex_outlives_its_client(lockstep: Served) -> None:
    fail(connect(lockstep.right), 50, lambda tick, state: 50.0 * (tick == 20) * np.eye(7)[0])
    assert_stopped_and_recover(connect(lockstep.right), {"controller_torque_discontinuity"})


@pytest.mark.parametrize(
    ("joint", "values"),
    [(3, [np.nan]), (3, [np.inf]), (1, [200.0]), (7, [1.1]), (2, [40.0, -40.0])],
    ids=["NaN", "Inf", "200 Nm", "just too steep", "alternating 40 Nm"],
)
def test_a_bad_torque(lockstep: Served, joint: int, values: list[float]) -> None:
    """Answer with a torque that no robot accepts, from WARM_UP on."""

    def law(tick: int, state: np.void) -> dict:
        tau = np.zeros(7)
        if tick >= WARM_UP:
            tau[joint - 1] = values[tick % len(values)]
        return {"tau_J_d": tau}

    with RawClient(lockstep.right) as raw:
        states = until_reflex(raw, law, 100)
    assert cycles_since_answer(states, WARM_UP) <= CYCLES
    assert reasons(states[-1]) == {"controller_torque_discontinuity"}
    assert_recovers(lockstep.right, "right", 300)


@pytest.mark.parametrize("nm_per_ms", [0.9, 0.05], ids=["stepped", "ramped"])
def test_a_joint_that_is_too_fast(lockstep: Served, nm_per_ms: float) -> None:
    """Push joint 1 until it is faster than its limit."""

    def push(tick: int, state: np.void) -> dict:
        # from what the robot has: a state that is shown twice asks for no step
        return {"tau_J_d": -np.eye(7)[0] * min(abs(float(state["tau_J_d"][0])) + nm_per_ms, 30.0)}

    with RawClient(lockstep.left) as raw:
        states = until_reflex(raw, push, 4000)
    assert cycles_since(states, too_fast) <= CYCLES
    assert reasons(states[-1]) == {"joint_velocity_violation"}
    assert_recovers(lockstep.left, "left")


@pytest.mark.parametrize(
    ("rad_per_ms", "condition", "name"),
    [
        # no arm reaches the limit fast: the allowed speed ends before it
        (2e-3, too_fast, "joint_velocity_violation"),
        (1e-5, beyond, "joint_position_limits_violation"),
    ],
    ids=["stepped", "ramped"],
)
def test_a_push_into_a_joint_limit(lockstep: Served, rad_per_ms: float, condition, name: str) -> None:
    """Move joint 7 towards its limit until it is too fast or beyond it."""
    go_home(connect(lockstep.left), np.array([0, 0, 0, 0, 0, 0, 3.0 - 1.090987]))
    goal: list[np.ndarray] = []

    def push(tick: int, state: np.void) -> dict:
        if not goal:
            goal.append(np.array(state["q"], dtype=float))
        goal[0][6] = min(goal[0][6] + rad_per_ms, 3.3)
        return {"tau_J_d": held(state, goal[0])}

    with RawClient(lockstep.left) as raw:
        states = until_reflex(raw, push, 9000)
    assert cycles_since(states, condition) <= CYCLES
    assert reasons(states[-1]) == {name}
    assert_recovers(lockstep.left, "left")


def test_a_contact_above_its_threshold(lockstep: Served) -> None:
    """Press the pad on the table until the force is above its threshold."""
    robot = connect(lockstep.left)
    force = 15.0
    robot.set_collision_behavior([5.0] * 7, [100.0] * 7, [4.0] * 6, [force] * 6)
    del robot
    goal: list[np.ndarray] = []

    def lower(tick: int, state: np.void) -> dict:
        if not goal:
            goal.append(np.array(state["q"], dtype=float))
        goal[0][1] += 2e-4
        return {"tau_J_d": held(state, goal[0])}

    with RawClient(lockstep.left) as raw:
        states = until_reflex(raw, lower, 3000)
    pressed = cycles_since(states, lambda state: bool(np.any(np.abs(state["O_F_ext_hat_K"]) > force)))
    assert pressed <= CYCLES
    assert reasons(states[-1]) == {"cartesian_reflex"}
    assert_recovers(lockstep.left, "left")


# up above the box, and then about the bases' axes towards each other until the left pad is at the right wrist
UP = {"left": np.array([0, -0.11, 0, 0.69, 0, -0.12, 0]), "right": np.array([0, -0.39, 0, 0.54, 0, -0.47, 0])}
ACROSS = {"left": -1.03, "right": 1.11}
UP_TICKS, ACROSS_TICKS = 1500, 3000


def nearest(q_left: np.ndarray, q_right: np.ndarray, cell=[]) -> float:  # noqa: B006 - built once
    """Distance of the arms, m, but between the pads, which may touch: by MuJoCo, in a model of the test's own."""
    if not cell:
        cell.append(simulated_cell("rice_box", 0.0, 0).plant.model)
    model = cell[0]
    data = mujoco.MjData(model)
    data.qpos[:7], data.qpos[7:14] = q_left, q_right
    mujoco.mj_kinematics(model, data)
    left, right = (
        [i for i in range(model.ngeom) if model.geom(i).name.startswith(f"{side}_")] for side in ("left", "right")
    )
    pads = {model.geom("left_pad").id, model.geom("right_pad").id}
    pairs = [(a, b) for a in left for b in right if {a, b} != pads]
    return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a, b in pairs)


def test_two_arms_that_come_near_each_other(lockstep: Served) -> None:
    """Move both arms towards each other until one is near the other."""
    sides = {"left": lockstep.left, "right": lockstep.right}

    def goal(side: str, q_start: np.ndarray, tick: int) -> np.ndarray:
        up, across = smooth(min(tick / UP_TICKS, 1.0)), smooth(min(max(tick / UP_TICKS - 1.0, 0.0) / 2.0, 1.0))
        return q_start + up * UP[side] + across * ACROSS[side] * np.eye(7)[0]

    states: dict[str, dict[int, np.void]] = {"left": {}, "right": {}}
    with RawClient(sides["left"]) as left, RawClient(sides["right"]) as right:
        raws = {"left": left, "right": right}
        for raw in raws.values():
            begin(raw, POSITIONS)
        moving = set(raws)
        for index, state in arriving((left, right)):
            side = SIDES[index]
            seen = states[side]
            if side not in moving or state["robot_mode"] == RobotMode.IDLE:
                continue  # from before Move: the paths begin with the motion
            seen[int(state["message_id"])] = state
            assert len(seen) < UP_TICKS + ACROSS_TICKS, "no reflex"
            if state["robot_mode"] == RobotMode.REFLEX:
                moving.remove(side)
                if not moving:
                    break
                continue
            q_start = np.array(next(iter(seen.values()))["q_d"], dtype=float)
            raws[side].command(state, q_c=goal(side, q_start, len(seen) - 1))
        for raw in raws.values():
            hang_up(raw)
    together = sorted(states["left"].keys() & states["right"].keys())[-20:]
    near = [nearest(states["left"][number]["q"], states["right"][number]["q"]) < PROXIMITY_M for number in together]
    assert near[0] is False
    for side, seen in states.items():
        reflex = max(seen)
        assert reasons(seen[reflex]) == {"self_collision_avoidance_violation"}, side
        assert reflex - together[near.index(True)] <= CYCLES
    for side, address in sides.items():
        robot = connect(address)
        robot.automatic_error_recovery()
        away = np.array(robot.read_once().q) - 0.3 * ACROSS[side] * np.eye(7)[0]
        move_to(robot, away, 1500)
        assert np.abs(np.array(robot.read_once().q) - away).max() < 0.01


def repeated(state: np.void, jump: float) -> dict:
    """Stay, but for a jump of joint 4."""
    return {"q_c": state["q_d"] + jump * np.eye(7)[3], "dq_c": jump * np.eye(7)[3]}


@pytest.mark.parametrize(
    ("kind", "faulty_tick", "jump", "name"),
    [
        (POSITIONS, WARM_UP, 5e-3, "joint_motion_generator_velocity_discontinuity"),
        (POSITIONS, WARM_UP, 1e-5, "joint_motion_generator_acceleration_discontinuity"),
        (VELOCITIES, WARM_UP, 0.5, "joint_motion_generator_velocity_discontinuity"),
        (VELOCITIES, WARM_UP, 0.009, "joint_motion_generator_acceleration_discontinuity"),
        (POSITIONS, 0, 0.1, "joint_position_motion_generator_start_pose_invalid"),
        (POSITIONS, WARM_UP, np.nan, "joint_motion_generator_position_limits_violation"),
        (VELOCITIES, WARM_UP, np.nan, "joint_motion_generator_velocity_limits_violation"),
    ],
)
def test_a_motion_that_cannot_be_followed(
    lockstep: Served, kind: Kind, faulty_tick: int, jump: float, name: str
) -> None:
    delays = []
    # before the first answer the robot repeats itself, and what it says while that is on its way is no delay of its own
    for _ in range(1 if faulty_tick else FIRST_ANSWERS):
        with RawClient(lockstep.left) as raw:
            states = until_reflex(
                raw, lambda tick, state: repeated(state, jump if tick == faulty_tick else 0.0), 100, kind
            )
        assert name in reasons(states[-1])
        assert all("motion_generator" in reason for reason in reasons(states[-1]))
        assert_recovers(lockstep.left, "left", 300)
        delays.append(cycles_since_answer(states, faulty_tick))
    assert min(delays) <= CYCLES, delays
