"""Time scaling and its references: place, velocity and acceleration agree, and what is allowed is within limits."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.interpolate import make_interp_spline

from hal.robots import FR3
from rtstack.control.records import POINT
from rtstack.model.rotation import log_so3
from rtstack.playback.path import RAMP_S, LoggedMotion, arm_path, brake, end_s, follow, pace, write_point
from rtstack.playback.run import SPEED_STEP, check_playback, fastest, loads
from rtstack.samples import SIDES
from rtstack.trials.assembly import arm_controllers, default_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import FASTEST, SLOWEST, PlaybackSpecification
from rtstack.trials.start_motion import posture
from rtstack.trials.tightening import limits_of_arms

TICK_S = 1e-3
GENERATE = (Phase.explicit, Phase.generate)  # an example takes long: a failing one is shown as it is found
speeds = st.floats(SLOWEST, FASTEST)
shares = st.floats(0.0, 1.0)


@pytest.fixture(scope="module")
def arms(cell):
    return arm_controllers(cell, default_parameters())


def played(paces, stop_share=None):
    """Place, rate and acceleration (n, 3) of every tick; braked after this share of the whole."""
    moments, memory = [], np.zeros(3)
    ticks = round(end_s(paces) / TICK_S)
    stop_tick = None if stop_share is None else round(stop_share * ticks)
    tick = 0
    while tick * TICK_S <= end_s(paces) + TICK_S:
        if tick == stop_tick:
            brake(paces, tick * TICK_S, memory)
        follow(paces, tick * TICK_S, memory)
        moments.append(memory.copy())
        tick += 1
    return np.array(moments)


def differences(values):
    """Central differences at the ticks between the first and the last one."""
    return (values[2:] - values[:-2]) / (2 * TICK_S)


@settings(max_examples=40)
@given(st.floats(0.5, 6.0), speeds, st.none() | shares)
def test_place_rate_and_acceleration_agree_and_begin_and_end_at_rest(duration_s, speed, stop_share):
    moments = played(pace(duration_s, speed), stop_share)
    place, rate, acceleration = moments.T
    jerk = 6.0 * speed / RAMP_S**2
    np.testing.assert_allclose(differences(place), rate[1:-1], atol=jerk * TICK_S**2)
    np.testing.assert_allclose(differences(rate), acceleration[1:-1], atol=4.0 * jerk * TICK_S)
    assert (place[0], rate[0], acceleration[0]) == (0.0, 0.0, 0.0)
    assert rate[-1] == pytest.approx(0.0, abs=1e-9)
    assert rate.min() > -1e-9
    assert rate.max() <= speed * (1.0 + 1e-9)
    assert place[-1] <= duration_s + 1e-9
    if stop_share is None:
        assert place[-1] == pytest.approx(duration_s, abs=1e-9)
    assert np.abs(np.diff(acceleration)).max() <= 2.0 * jerk * TICK_S  # it never jumps


@pytest.fixture(scope="module")
def middle(cell, arms):
    """Joints (2, 7) where both pads are far from everything."""
    found = []
    for k, (arm, mounting, y) in enumerate(zip(arms, (cell.left, cell.right), (0.25, -0.25), strict=True)):
        arm.sample["q"][0] = mounting.home
        arm.observe()
        point = np.zeros(1, POINT)
        point["rotation"][0] = arm.workspace["rotation"][0]
        point["position"][0], point["xi"] = (0.0, y, 0.5), mounting.home[0]
        found.append(posture(arm, np.array(mounting.home), point[0], SIDES[k]))
    return np.array(found)


def wandering(middle, seed, size):
    """Two arms that go through random postures, `size` rad away from the middle in each joint."""
    rng = np.random.default_rng(seed)
    duration_s = 0.8
    t = np.linspace(0.0, duration_s, 7)
    curves = []
    for q in middle:
        curves.append(make_interp_spline(t, q + size * rng.uniform(-1.0, 1.0, (7, 7)), 5))
    return LoggedMotion(Path("wandering.mcap"), "", duration_s, tuple(curves))


@settings(max_examples=8, phases=GENERATE)
@given(st.integers(0, 10_000), speeds, st.none() | shares)
def test_references_obey_the_chain_rule(arms, middle, seed, speed, stop_share):
    motion = wandering(middle, seed, 0.1)
    path = arm_path(motion, 0, arms[0])
    moments = played(pace(motion.duration_s, speed), stop_share)
    points = np.zeros((len(moments), 1), POINT)
    three, turn = np.zeros(3), np.zeros((3, 3))
    for moment, point in zip(moments, points, strict=True):
        write_point(path.stations, moment, three, turn, point)
    points = points[:, 0]
    fast = speed * np.abs(path.stations["along"]).max() + 1e-3
    near = 0.03 * fast + 2e-3 * speed**2 * np.abs(path.stations["bend"]).max()
    np.testing.assert_allclose(differences(points["position"]), points["twist"][1:-1, :3], atol=near)
    np.testing.assert_allclose(differences(points["xi"]), points["dxi"][1:-1], atol=near)
    turned = np.zeros((len(points) - 2, 3))
    for k in range(len(turned)):
        log_so3(np.ascontiguousarray(points["rotation"][k + 2] @ points["rotation"][k].T), turned[k])
    np.testing.assert_allclose(turned / (2 * TICK_S), points["twist"][1:-1, 3:], atol=near)
    # the feedforward is Lambda times the acceleration: found again from the twist, and Lambda from the joints there
    for k in range(1, len(points) - 1, 97):
        q = motion.joints(0, np.array([min(moments[k, 0], motion.duration_s)]))[0]
        arms[0].sample["q"], arms[0].sample["dq"] = q, 0.0
        arms[0].observe()
        work = arms[0].workspace[0]
        acceleration = (points["twist"][k + 1] - points["twist"][k - 1]) / (2 * TICK_S)
        wanted = np.linalg.solve(work["J"] @ np.linalg.solve(work["M"], work["J"].T), acceleration)
        force = np.abs(path.stations["push_bend"]).max() * speed**2 + np.abs(path.stations["push"]).max() * speed
        np.testing.assert_allclose(points["wrench_ff"][k], wanted, atol=0.05 * force + 0.1)


@settings(max_examples=10, phases=GENERATE)
@given(st.integers(0, 10_000), st.floats(0.002, 0.1), shares)
def test_the_quickest_that_is_allowed_is_within_the_limits(cell, arms, middle, seed, size, stop_share):
    motion = wandering(middle, seed, size)
    paths = arm_path(motion, 0, arms[0]), arm_path(motion, 1, arms[1])
    limits = limits_of_arms(cell)[0]
    for speed in np.geomspace(FASTEST, SLOWEST, 8):
        try:
            check_playback(paths, speed, (limits, limits), cell)
            break
        except TrialError:
            continue
    else:
        return
    s, rate, acceleration = played(pace(motion.duration_s, speed), stop_share).T
    s = np.minimum(s, motion.duration_s)
    for side, arm in enumerate(arms):
        q, dq, ddq = (motion.joints(side, s, order) for order in range(3))
        ddq = ddq * rate[:, None] ** 2 + dq * acceleration[:, None]
        dq = dq * rate[:, None]
        model = arm.model.pin_model
        data = model.createData()
        for k in range(0, len(s), 7):
            assert np.all(dq[k] <= FR3.limits.dq_upper(q[k]))
            assert np.all(dq[k] >= FR3.limits.dq_lower(q[k]))
            torque = pin.rnea(model, data, q[k], dq[k], ddq[k])  # pyright: ignore[reportAttributeAccessIssue]
            torque = torque + default_parameters().inertia.B_theta * ddq[k]  # not the equations of limits.py
            assert np.all(np.abs(torque) <= FR3.limits.tau_max)
            assert np.all((q[k] > limits.q_lower) & (q[k] < limits.q_upper))
        place = paths[side].stations["position"]
        assert np.all((place >= limits.ee_lower) & (place <= limits.ee_upper))


def test_a_speed_is_refused_for_the_reason_that_it_has(cell, arms, middle):
    motion = wandering(middle, 1, 0.02)
    path = arm_path(motion, 0, arms[0])
    limits = limits_of_arms(cell)[0]
    slow, quick = loads(path, 0.5, limits), loads(path, 1.0, limits)
    assert quick[0].share == pytest.approx(2.0 * slow[0].share, rel=0.2)  # the limit itself depends on the place
    assert quick[2].share == pytest.approx(8.0 * slow[2].share)  # jerk
    for speed in (0.09, 4.1, float("nan")):
        with pytest.raises(ValidationError, match="speed"):
            PlaybackSpecification("log.mcap", speed=speed)


@pytest.mark.parametrize(("seed", "size"), [(1, 0.02), (2, 0.1)])
def test_the_fastest_speed_is_allowed_and_the_next_one_is_not(cell, arms, middle, seed, size):
    motion = wandering(middle, seed, size)
    paths = tuple(arm_path(motion, side, arms[side]) for side in (0, 1))
    limits = limits_of_arms(cell)[0]
    speed = fastest(paths, (limits, limits), cell)
    check_playback(paths, speed, (limits, limits), cell)
    if speed < FASTEST:
        with pytest.raises(TrialError, match="play it more slowly"):
            check_playback(paths, speed + SPEED_STEP, (limits, limits), cell)
