"""A fault is reported within two cycles of its condition: counted in message ids, read from the bytes."""

import numpy as np
import pytest

from tests.support.fci import fault_delay as delay
from tests.support.fci.fault_delay import CYCLES, POSITIONS, VELOCITIES, WARM_UP, Kind
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

FIRST_ANSWERS = 4


@pytest.mark.parametrize(
    ("joint", "values"),
    [(3, [np.nan]), (3, [np.inf]), (1, [200.0]), (7, [1.1]), (2, [40.0, -40.0])],
    ids=["NaN", "Inf", "200 Nm", "just too steep", "alternating 40 Nm"],
)
def test_a_bad_torque(lockstep: Served, joint: int, values: list[float]) -> None:
    delay.bad_torque(lockstep, joint, values)


@pytest.mark.parametrize("nm_per_ms", [0.9, 0.05], ids=["stepped", "ramped"])
def test_a_joint_that_is_too_fast(lockstep: Served, nm_per_ms: float) -> None:
    delay.joint_too_fast(lockstep, nm_per_ms)


@pytest.mark.parametrize(
    ("rad_per_ms", "condition", "name"),
    [
        # no arm reaches the limit fast: the allowed speed ends before it
        (2e-3, delay.too_fast, "joint_velocity_violation"),
        (1e-5, delay.beyond, "joint_position_limits_violation"),
    ],
    ids=["stepped", "ramped"],
)
def test_a_push_into_a_joint_limit(lockstep: Served, rad_per_ms: float, condition, name: str) -> None:
    delay.push_into_joint_limit(lockstep, rad_per_ms, condition, name)


def test_a_contact_above_its_threshold(lockstep: Served) -> None:
    delay.contact_above_threshold(lockstep)


def test_two_arms_that_come_near_each_other(lockstep: Served) -> None:
    delay.self_collision(lockstep)


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
            states = delay.until_reflex(
                raw, lambda tick, state: repeated(state, jump if tick == faulty_tick else 0.0), 100, kind
            )
        assert name in delay.reasons(states[-1])
        assert all("motion_generator" in reason for reason in delay.reasons(states[-1]))
        delay.assert_recovers(lockstep.left, "left")
        delays.append(delay.cycles_since_answer(states, faulty_tick))
    assert min(delays) <= CYCLES, delays


@pytest.mark.realtime
@pytest.mark.parametrize("stall_ms", [25, 300])
def test_a_client_that_stalls(realtime: Served, stall_ms: int) -> None:
    delay.stalling_client(realtime, stall_ms)
