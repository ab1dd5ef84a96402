"""The filter's promises: for any requests no faster, no harder and no more sudden than it says, and never past them."""

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtstack.control.records import POINT
from rtstack.teleoperation.follower import (
    BRAKING_S,
    FOLLOWER,
    SMOOTH_S,
    SOFT_S,
    advance,
    begin,
    coordinates,
    hold,
    write_point,
)

DT = 1e-3
START = np.array([0.0, 0.35, 0.26])
metres = st.floats(-0.3, 0.3)
radians = st.floats(-0.6, 0.6)
goals = st.tuples(metres, metres, metres, radians, radians, radians)
requests = st.lists(st.tuples(goals, st.integers(1, 120)), min_size=1, max_size=12)


def started(rotation=None):
    follower = np.zeros(1, FOLLOWER)
    begin(follower, START, np.eye(3) if rotation is None else rotation)
    return follower


def followed(asked, speed, turn_speed):
    """Commands (n, 6) for requests, each with the ticks until the next one; at rest before and after them."""
    follower = started()
    commands = [follower["command"][0].copy()] * 3
    for goal, ticks in [*asked, (asked[-1][0], 4000)]:
        follower["goal"][0] = np.concatenate([START, np.zeros(3)]) + goal
        for _ in range(ticks):
            advance(follower, speed, turn_speed)
            commands.append(follower["command"][0].copy())
    return np.array(commands)


@settings(max_examples=60)
@given(asked=requests, speed=st.floats(0.05, 0.4))
def test_velocity_acceleration_and_jerk_are_bounded_for_any_requests(asked, speed):
    turn_speed = 2.5 * speed
    commands = followed(asked, speed, turn_speed)
    for half, bound in ((commands[:, :3], speed), (commands[:, 3:], turn_speed)):
        velocity = np.diff(half, axis=0) / DT
        acceleration = np.diff(velocity, axis=0) / DT
        jerk = np.diff(acceleration, axis=0) / DT
        rounding = 1e-15 / DT
        assert np.linalg.norm(velocity, axis=1).max() <= bound + rounding
        assert np.linalg.norm(acceleration, axis=1).max() <= 2 * bound / SMOOTH_S + 4 * rounding / DT
        assert np.linalg.norm(jerk, axis=1).max() <= 4 * bound / (SMOOTH_S * SOFT_S) + 8 * rounding / DT**2


@settings(max_examples=60)
@given(asked=requests)
def test_the_command_stays_between_the_requests_and_arrives(asked):
    commands = followed(asked, 0.4, 1.0)
    start = np.concatenate([START, np.zeros(3)])
    reached = np.array([start, *(start + goal for goal, _ in asked)])
    assert (commands >= reached.min(axis=0) - 1e-9).all()
    assert (commands <= reached.max(axis=0) + 1e-9).all()
    np.testing.assert_allclose(commands[-1], reached[-1], atol=1e-6)


@settings(max_examples=60)
@given(asked=requests, speed=st.floats(0.05, 0.4))
def test_held_it_brakes_at_once_and_stands_still_within_its_braking_time(asked, speed):
    follower = started()
    for goal, ticks in asked:
        follower["goal"][0] = np.concatenate([START, np.zeros(3)]) + goal
        for _ in range(ticks):
            advance(follower, speed, 2.5 * speed)
    hold(follower[None])
    for _ in range(round(BRAKING_S / DT) + 1):
        advance(follower, speed, 2.5 * speed)
    assert np.abs(follower["velocity"][0]).max() <= 1e-9


@settings(max_examples=60)
@given(rotation=goals, goal=goals)
def test_pose_and_twist_agree_with_another_library(rotation, goal):
    origin = pinocchio.exp3(np.array(rotation[3:]) * 4.0)
    follower = started(np.ascontiguousarray(origin))
    point = np.zeros(1, POINT)
    asked = np.ascontiguousarray(origin @ pinocchio.exp3(np.array(goal[3:])))
    coordinates(follower, START + goal[:3], asked, follower["goal"][0])
    rotations = []
    for _ in range(60):
        advance(follower, 0.3, 1.0)
        write_point(follower, point)
        rotations.append(point["rotation"][0].copy())
    np.testing.assert_allclose(point["twist"][0][:3], follower["velocity"][0][:3])
    turned = pinocchio.log3(rotations[-1] @ rotations[-2].T) / DT  # the mean of the last tick, the twist its end
    before = pinocchio.log3(rotations[-2] @ rotations[-3].T) / DT
    np.testing.assert_allclose(point["twist"][0][3:], turned, atol=np.abs(turned - before).max() + 2e-4)
    for _ in range(3000):
        advance(follower, 0.3, 1.0)
    write_point(follower, point)
    np.testing.assert_allclose(point["rotation"][0], asked, atol=1e-6)


def test_a_request_that_stays_is_reached_with_no_velocity_left():
    follower = started()
    follower["goal"][0][1] -= 0.1
    for _ in range(2000):
        advance(follower, 0.2, 0.5)
    assert follower["command"][0][1] == pytest.approx(START[1] - 0.1, abs=1e-9)
    assert np.abs(follower["velocity"][0]).max() < 1e-9
