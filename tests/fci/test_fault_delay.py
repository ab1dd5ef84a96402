"""A fault is reported within two cycles of its condition: counted in message ids, read from the bytes.

After each, a recovery with the real client and a motion.
"""

import select
import socket
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from fci_client import DAMPING, STIFFNESS, connect, go_home, hold, move_to, smooth, torque_control
from fci_raw import RawClient
from fci_server import Served

from hal.robot_errors import ROBOT_ERRORS
from hal.robots import FR3
from hal.state import RobotMode
from sim_robot.cell import simulated_cell
from sim_robot.fci.protocol import Controller, Generator, MoveStatus
from sim_robot.model import PROXIMITY_M
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene

FIRST_ANSWERS = 4
CYCLES = 2
LOST_PACKETS = 20
WARM_UP = 20
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
    hang_up(raw)
    return states


def assert_recovers(address: str, side: str) -> None:
    robot = connect(address)
    robot.automatic_error_recovery()
    state = robot.read_once()
    assert names(state.current_errors) == set()
    q_hold = np.array(state.q)
    torque_control(robot, 50, lambda tick, state: hold(state, q_hold))
    go_home(robot, side=side)
    home = getattr(load_scene(), side).home
    assert np.abs(np.array(robot.read_once().q) - home).max() < 0.01


def names(errors: object) -> set[str]:
    """Names of the errors of a client's state."""
    return {name for name in ROBOT_ERRORS if getattr(errors, name)}


def reasons(state: np.void) -> set[str]:
    return {name for name, raised in zip(ROBOT_ERRORS, state["reflex_reason"], strict=True) if raised}


def held(state: np.void, q_hold: np.ndarray) -> np.ndarray:
    return STIFFNESS * (q_hold - state["q"]) - DAMPING * state["dq"]


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


@pytest.mark.parametrize(
    ("joint", "values"),
    [(3, [np.nan]), (3, [np.inf]), (1, [200.0]), (7, [1.1]), (2, [40.0, -40.0])],
    ids=["NaN", "Inf", "200 Nm", "just too steep", "alternating 40 Nm"],
)
def test_a_bad_torque(lockstep: Served, joint: int, values: list[float]) -> None:
    def law(tick: int, state: np.void) -> dict:
        tau = np.zeros(7)
        if tick >= WARM_UP:
            tau[joint - 1] = values[tick % len(values)]
        return {"tau_J_d": tau}

    with RawClient(lockstep.right) as raw:
        states = until_reflex(raw, law, 100)
    assert cycles_since_answer(states, WARM_UP) <= CYCLES
    assert reasons(states[-1]) == {"controller_torque_discontinuity"}
    assert_recovers(lockstep.right, "right")


@pytest.mark.parametrize("nm_per_ms", [0.9, 0.05], ids=["stepped", "ramped"])
def test_a_joint_that_is_too_fast(lockstep: Served, nm_per_ms: float) -> None:
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
        (2e-3, too_fast, "joint_velocity_violation"),  # nobody gets to the limit fast: the allowed speed ends before it
        (1e-5, beyond, "joint_position_limits_violation"),
    ],
    ids=["stepped", "ramped"],
)
def test_a_push_into_a_joint_limit(lockstep: Served, rad_per_ms: float, condition, name: str) -> None:
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
        while moving:  # each arm is answered when its own state arrives: nobody waits for the other one
            ready, _, _ = select.select([raws[side].udp for side in moving], (), (), 5.0)
            assert ready, "no state of either arm"
            for side in [side for side in moving if raws[side].udp in ready]:
                raw, seen = raws[side], states[side]
                state = raw.next_state()
                if state["robot_mode"] == RobotMode.IDLE:
                    continue  # from before Move: the paths begin with the motion
                seen[int(state["message_id"])] = state
                assert len(seen) < UP_TICKS + ACROSS_TICKS, "no reflex"
                if state["robot_mode"] == RobotMode.REFLEX:
                    moving.remove(side)
                    continue
                q_start = np.array(next(iter(seen.values()))["q_d"], dtype=float)
                raw.command(state, q_c=goal(side, q_start, len(seen) - 1))
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
        assert_recovers(lockstep.left, "left")
        delays.append(cycles_since_answer(states, faulty_tick))
    assert min(delays) <= CYCLES, delays


@pytest.mark.realtime
@pytest.mark.parametrize("stall_ms", [25, 300])
def test_a_client_that_stalls(realtime: Served, stall_ms: int) -> None:
    """The vendor's 20 packets, in ms of the robot's clock: one that the host holds up blames the client for no ms."""

    def law(tick: int, state: np.void) -> dict | None:
        return None if WARM_UP <= tick < WARM_UP + stall_ms else {"tau_J_d": np.zeros(7)}

    with RawClient(realtime.right) as raw:
        states = until_reflex(raw, law, 400)
    assert cycles_since_answer(states, WARM_UP) <= LOST_PACKETS + CYCLES
    assert reasons(states[-1]) == {"communication_constraints_violation"}
    assert_recovers(realtime.right, "right")
