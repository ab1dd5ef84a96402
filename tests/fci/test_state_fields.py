"""Every field of RobotState through a joint motion, a Cartesian motion and torque control into the table.

Each is non-zero somewhere, and the fields agree with each other as robot_state.h says. Bytes, not pylibfranka, so that
the fields are seen that it does not pass on.
"""

from collections.abc import Callable

import numpy as np
import pytest

from hal.robots import FR3
from hal.wire import ROBOT_STATE
from sim_robot.arm_description import arm_description
from sim_robot.fci.protocol import Command, MoveStatus
from sim_robot.fci.robot_state import ACCELEROMETER_BIT, ACCELEROMETER_NOISE
from sim_robot.kinematics import KINEMATICS_RECORD, forward_kinematics
from sim_robot.plant import faces
from sim_robot.scene import load_scene
from tests.support.fci.motions import DIRECTION as UP
from tests.support.fci.motions import held, there_and_back
from tests.support.fci.raw import RawClient
from tests.support.fci.server import serve

DT = 1e-3
MOVE = 2
TICKS = 1200
LOAD = (0.2, 0.01, 0.02, 0.03, *np.diag([1e-3, 2e-3, 3e-3]).ravel())
K = np.array([[0.0, -1.0, 0.0, 0.02], [1.0, 0.0, 0.0, 0.03], [0.0, 0.0, 1.0, 0.05], [0.0, 0.0, 0.0, 1.0]])


def run(raw: RawClient, kind: tuple[int, int], law: Callable[[int, np.void, np.void], dict], ticks: int) -> np.ndarray:
    """Move with `law(tick, first state, state)` until a reflex or the end; the states."""
    assert raw.move(*kind) == MoveStatus.MOTION_STARTED
    states = [raw.moving_state()]
    for tick in range(ticks):
        raw.command(states[-1], **law(tick, states[0], states[-1]))
        states.append(raw.state())
        if states[-1]["robot_mode"] != MOVE:
            break
    flag = "torque_command_finished" if kind[0] == 2 else "motion_generation_finished"
    if states[-1]["robot_mode"] == MOVE:
        raw.command(states[-1], **law(ticks, states[0], states[-1]), **{flag: 1})
    raw.answer()
    return np.array(states, ROBOT_STATE)


def turned(tick: int, first: np.void, state: np.void) -> dict:
    return {"q_c": first["q_d"] + 0.1 * there_and_back(tick / TICKS) * UP}


def lifted(tick: int, first: np.void, state: np.void) -> dict:
    pose = np.array(first["O_T_EE_c"], dtype=float)
    pose[14] += 0.03 * there_and_back(tick / TICKS)
    elbow = np.array(first["elbow_c"], dtype=float) + (0.03 * there_and_back(tick / TICKS), 0.0)
    return {"O_T_EE_c": pose, "elbow_c": elbow, "valid_elbow": 1}


def lowered(tick: int, first: np.void, state: np.void) -> dict:
    goal = np.array(first["q"], dtype=float)
    goal[1] += 2e-4 * tick
    return {"tau_J_d": held(state, goal)}


@pytest.fixture(scope="module")
def motions() -> dict[str, np.ndarray]:
    with serve("--lockstep") as served, RawClient(served.left) as raw:
        raw.connect()
        thresholds = np.concatenate([[2.0] * 7, [100.0] * 7] * 2 + [[4.0] * 6, [15.0] * 6] * 2)
        for command, values in (
            (Command.SET_LOAD, LOAD),
            (Command.SET_EE_TO_K, K.T.ravel()),
            (Command.SET_COLLISION_BEHAVIOR, thresholds),
        ):
            raw.send(command, np.array(values, dtype=float).tobytes())
            assert raw.answer()[2] == b"\0"
        rest = np.array([raw.state()], ROBOT_STATE)
        joint = run(raw, (0, 0), turned, TICKS)
        pose = run(raw, (0, 2), lifted, TICKS)
        torque = run(raw, (2, 4), lowered, 4000)
        reflex = np.array([raw.state()], ROBOT_STATE)
        raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
        assert raw.answer()[2] == b"\0"
        joints = np.concatenate([[2.0] * 7, [5.0] * 7] * 2 + [[4.0] * 6, [500.0] * 6] * 2)
        raw.send(Command.SET_COLLISION_BEHAVIOR, joints.tobytes())
        assert raw.answer()[2] == b"\0"
        pressed = run(raw, (2, 4), lowered, 4000)
    return {"rest": rest, "joint": joint, "pose": pose, "torque": torque, "reflex": reflex, "pressed": pressed}


def jacobian(q: np.ndarray) -> np.ndarray:
    """Of the end effector as the arm has it, (6, 7), from the nominal kinematics."""
    body = np.zeros(1, KINEMATICS_RECORD)[0]
    body["T_parent_joint"] = arm_description(FR3).T_parent_joint
    body["joint_T_face"] = faces(load_scene())[0]
    forward_kinematics(body, np.array(q, dtype=float))
    return np.array(body["J"])


def test_no_field_stays_at_zero(motions: dict[str, np.ndarray]) -> None:
    states = np.concatenate(list(motions.values()))
    assert [name for name in ROBOT_STATE.names or () if not np.any(states[name])] == []
    for name in ROBOT_STATE.names or ():
        assert np.all(np.isfinite(states[name].astype(float))), name


def test_what_is_desired_agrees_with_the_joints(motions: dict[str, np.ndarray]) -> None:
    for kind in ("joint", "pose"):
        for state in motions[kind][100::200]:
            assert state["O_dP_EE_d"] == pytest.approx(jacobian(state["q_d"]) @ state["dq_d"], abs=2e-4), kind
            assert state["elbow_d"] == pytest.approx((state["q_d"][2], -1.0), abs=1e-6)
            assert state["elbow"] == pytest.approx((state["q"][2], -1.0), abs=1e-6)


def test_rates_are_difference_quotients(motions: dict[str, np.ndarray]) -> None:
    for kind in ("joint", "pose"):
        states = motions[kind][5:]
        for value, rate, tolerance in (
            ("q_d", "dq_d", 5e-4),
            ("dq_d", "ddq_d", 5e-4),
            ("O_dP_EE_c", "O_ddP_EE_c", 2e-3),
            ("elbow_c", "delbow_c", 5e-4),
            ("delbow_c", "ddelbow_c", 5e-4),
        ):
            quotient = np.diff(states[value].astype(float), axis=0) / DT
            assert np.abs(quotient - states[rate][1:]).max() < tolerance, (kind, value)


def test_motors_and_accelerometers(motions: dict[str, np.ndarray]) -> None:
    rest = motions["rest"][0]
    assert np.linalg.norm(rest["accelerometer_top"], axis=1) == pytest.approx(9.81, abs=0.3)
    assert np.linalg.norm(rest["accelerometer_bottom"], axis=1) == pytest.approx(9.81, abs=0.3)
    assert rest["accelerometer_bottom"][0] == pytest.approx((0.0, 0.0, 9.81), abs=0.3)
    moving = motions["joint"][TICKS // 4]
    assert moving["theta"] == pytest.approx(moving["q"], abs=5e-3)
    assert moving["dtheta"] == pytest.approx(moving["dq"], abs=2e-2)
    assert np.ptp(motions["joint"]["accelerometer_top"], axis=0).max() > 0.1


def test_an_accelerometer_is_a_sensor_of_its_own(motions: dict[str, np.ndarray]) -> None:
    """At the base, which never moves, it shows gravity, its noise and its bit; at link 1's ends two noises."""
    states = motions["joint"]
    base = states["accelerometer_bottom"][:, 0].astype(float)
    assert base.mean(axis=0) == pytest.approx((0.0, 0.0, 9.81), abs=0.02)
    assert base.std(axis=0) == pytest.approx(np.hypot(ACCELEROMETER_NOISE, ACCELEROMETER_BIT / np.sqrt(12.0)), rel=0.15)
    assert base / ACCELEROMETER_BIT == pytest.approx(np.round(base / ACCELEROMETER_BIT), abs=1e-3)
    assert np.abs(np.corrcoef(base.T) - np.eye(3)).max() < 0.15
    # beyond the noise of differentiated encoders: joint 3's origin moves with joints 1 and 2 alone
    top = states["accelerometer_top"][:, 1].astype(float)
    assert np.linalg.norm(np.diff(top, axis=0), axis=1).mean() < 0.3


def test_load_and_frames(motions: dict[str, np.ndarray]) -> None:
    state = motions["joint"][0]
    assert (state["m_load"], *state["F_x_Cload"], *state["I_load"]) == pytest.approx(LOAD)
    assert np.abs(state["EE_T_K"].reshape(4, 4).T - K).max() < 1e-6
    for state in motions["torque"][::50]:
        O_R_K = state["O_T_EE"].reshape(4, 4).T[:3, :3] @ K[:3, :3]
        for half in (slice(3), slice(3, 6)):
            assert state["K_F_ext_hat_K"][half] == pytest.approx(O_R_K.T @ state["O_F_ext_hat_K"][half], abs=1e-3)


def test_contact_then_collision_and_its_reflex(motions: dict[str, np.ndarray]) -> None:
    states, reflex = motions["torque"], motions["reflex"][0]
    contact, collision = (states[f"cartesian_{name}"].max(axis=1) for name in ("contact", "collision"))
    assert np.argmax(contact > 0) < np.argmax(collision > 0)
    assert np.argmax(collision > 0) == len(states) - 1  # the very state that shows it
    assert states[-1]["errors"][7] == 1  # cartesian_reflex
    assert reflex["errors"].tolist() == reflex["reflex_reason"].tolist()
    assert reflex["cartesian_collision"].max() == 1.0
    assert motions["pressed"][0]["cartesian_collision"].max() == 0.0  # the recovery cleared it
    assert motions["pressed"][-1]["joint_collision"].max() == motions["pressed"][-1]["errors"][6] == 1  # joint_reflex
    assert np.array_equal(states["joint_contact"], (np.abs(states["tau_ext_hat_filtered"]) > 2.0))


def test_success_rate(motions: dict[str, np.ndarray]) -> None:
    assert motions["rest"]["control_command_success_rate"][0] == 0.0
    assert np.all(motions["joint"]["control_command_success_rate"] == 1.0)
    assert motions["reflex"]["control_command_success_rate"][0] == 0.0
