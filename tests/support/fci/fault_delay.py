"""Faults of a client and of contact: each has to be reported within two cycles of its condition.

Counted in message ids, read from the bytes. After each, a recovery with the real client and a motion.
"""

import select
import socket
from collections.abc import Callable

import mujoco
import numpy as np

from hal.robot_errors import ROBOT_ERRORS
from hal.robots import FR3
from hal.state import RobotMode
from sim_robot.cell import simulated_cell
from sim_robot.fci.protocol import Controller, Generator, MoveStatus
from sim_robot.model import PROXIMITY_M
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.fci.client import DAMPING, STIFFNESS, connect, go_home, hold, move_to, smooth, torque_control
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

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


def bad_torque(served: Served, joint: int, values: list[float]) -> None:
    """Answer with a torque that no robot accepts, from WARM_UP on."""

    def law(tick: int, state: np.void) -> dict:
        tau = np.zeros(7)
        if tick >= WARM_UP:
            tau[joint - 1] = values[tick % len(values)]
        return {"tau_J_d": tau}

    with RawClient(served.right) as raw:
        states = until_reflex(raw, law, 100)
    assert cycles_since_answer(states, WARM_UP) <= CYCLES
    assert reasons(states[-1]) == {"controller_torque_discontinuity"}
    assert_recovers(served.right, "right")


def joint_too_fast(served: Served, nm_per_ms: float) -> None:
    """Push joint 1 until it is faster than its limit."""

    def push(tick: int, state: np.void) -> dict:
        # from what the robot has: a state that is shown twice asks for no step
        return {"tau_J_d": -np.eye(7)[0] * min(abs(float(state["tau_J_d"][0])) + nm_per_ms, 30.0)}

    with RawClient(served.left) as raw:
        states = until_reflex(raw, push, 4000)
    assert cycles_since(states, too_fast) <= CYCLES
    assert reasons(states[-1]) == {"joint_velocity_violation"}
    assert_recovers(served.left, "left")


def push_into_joint_limit(served: Served, rad_per_ms: float, condition, name: str) -> None:
    """Move joint 7 towards its limit until it is too fast or beyond it."""
    go_home(connect(served.left), np.array([0, 0, 0, 0, 0, 0, 3.0 - 1.090987]))
    goal: list[np.ndarray] = []

    def push(tick: int, state: np.void) -> dict:
        if not goal:
            goal.append(np.array(state["q"], dtype=float))
        goal[0][6] = min(goal[0][6] + rad_per_ms, 3.3)
        return {"tau_J_d": held(state, goal[0])}

    with RawClient(served.left) as raw:
        states = until_reflex(raw, push, 9000)
    assert cycles_since(states, condition) <= CYCLES
    assert reasons(states[-1]) == {name}
    assert_recovers(served.left, "left")


def contact_above_threshold(served: Served) -> None:
    """Press the pad on the table until the force is above its threshold."""
    robot = connect(served.left)
    force = 15.0
    robot.set_collision_behavior([5.0] * 7, [100.0] * 7, [4.0] * 6, [force] * 6)
    del robot
    goal: list[np.ndarray] = []

    def lower(tick: int, state: np.void) -> dict:
        if not goal:
            goal.append(np.array(state["q"], dtype=float))
        goal[0][1] += 2e-4
        return {"tau_J_d": held(state, goal[0])}

    with RawClient(served.left) as raw:
        states = until_reflex(raw, lower, 3000)
    pressed = cycles_since(states, lambda state: bool(np.any(np.abs(state["O_F_ext_hat_K"]) > force)))
    assert pressed <= CYCLES
    assert reasons(states[-1]) == {"cartesian_reflex"}
    assert_recovers(served.left, "left")


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


def self_collision(served: Served) -> None:
    """Move both arms towards each other until one is near the other."""
    sides = {"left": served.left, "right": served.right}

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


def stalling_client(served: Served, stall_ms: int) -> None:
    """The vendor's 20 packets, in ms of the robot's clock: one that the host holds up blames the client for no ms."""

    def law(tick: int, state: np.void) -> dict | None:
        return None if WARM_UP <= tick < WARM_UP + stall_ms else {"tau_J_d": np.zeros(7)}

    with RawClient(served.right) as raw:
        states = until_reflex(raw, law, 400)
    assert cycles_since_answer(states, WARM_UP) <= LOST_PACKETS + CYCLES
    assert reasons(states[-1]) == {"communication_constraints_violation"}
    assert_recovers(served.right, "right")
