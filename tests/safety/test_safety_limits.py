"""Limits are tightened and never widened; whoever tries is told the key, the value and the bound."""

from dataclasses import FrozenInstanceError, replace
from math import inf, nan, nextafter, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.limits import OwnLimits
from hal.robots import FR3
from rtstack.safety.judge import Base, SafetyJudge, Tool
from rtstack.safety.limits import HARDWARE, NAMES, LimitWidened, control_limits, within_own

LOWER = ("q_lower", "ee_lower", "arm_distance_min")


def test_the_hardware_s_limits_are_those_of_hal_and_a_margin_inside():
    np.testing.assert_allclose(HARDWARE.q_lower, FR3.limits.q_lower + 0.005)
    np.testing.assert_allclose(HARDWARE.q_upper, FR3.limits.q_upper - 0.005)
    np.testing.assert_allclose(HARDWARE.dq_max, 0.98 * FR3.limits.dq_max)
    for name in ("tau_max", "tau_J_max"):
        assert getattr(HARDWARE, name) == tuple(FR3.limits.tau_max)
    assert HARDWARE.tau_rate_max == 1000.0
    assert HARDWARE.power_max == pytest.approx(4 * 87 * 2.62 + 12 * (5.26 + 4.18 + 5.26))
    assert (HARDWARE.ee_speed_max, HARDWARE.arm_distance_min) == (3.0, 0.02)
    assert (HARDWARE.state_gap_max_s, HARDWARE.pair_skew_max_s) == (0.02, 0.02)
    assert (HARDWARE.ee_lower, HARDWARE.ee_upper) == ((-inf,) * 3, (inf,) * 3)


def _changed(name: str, outwards: bool):
    """Return the bound of `name` moved by one step of a double, outwards or inwards, and the bound itself."""
    bound = getattr(HARDWARE, name)
    far = -inf if (name in LOWER) == outwards else inf
    if isinstance(bound, tuple):
        many = [b if abs(b) != inf else (-5.0 if b < 0 else 5.0) for b in bound]
        return [*many[:1], nextafter(many[1], far), *many[2:]], many
    return nextafter(bound, far), bound


@pytest.mark.parametrize("name", NAMES)
def test_a_limit_is_taken_at_its_bound_and_inside_and_refused_one_step_beyond(name):
    inside, bound = _changed(name, outwards=False)
    for value in (inside, bound):
        taken = getattr(HARDWARE.tightened({name: value}), name)
        assert (list(taken) if isinstance(taken, tuple) else taken) == value
    if name.startswith("ee_") and name != "ee_speed_max":
        return  # nothing is beyond infinity
    outside, _ = _changed(name, outwards=True)
    side = "at least" if name in LOWER else "at most"
    with pytest.raises(LimitWidened, match=f"safety.{name} = .*may only tighten, .* must be {side} "):
        HARDWARE.tightened({name: outside})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "bad", [nan, inf, -inf, "1.0", None, True, {}, [], [1.0, 2.0], [True] * 7, [nan] * 7, ["x"] * 7]
)
def test_nonsense_is_refused(name, bad):
    with pytest.raises(LimitWidened, match=f"safety.{name}"):
        HARDWARE.tightened({name: bad})


def test_a_maximum_must_leave_something():
    for bad in (0.0, -1.0):
        with pytest.raises(LimitWidened, match="positive"):
            HARDWARE.tightened({"power_max": bad})
        with pytest.raises(LimitWidened, match="positive"):
            HARDWARE.tightened({"pair_skew_max_s": bad})
    with pytest.raises(LimitWidened, match="leaves no room below q_upper"):
        HARDWARE.tightened({"q_lower": list(HARDWARE.q_upper)})
    box = HARDWARE.tightened({"ee_upper": [1, 1, 1]})
    with pytest.raises(LimitWidened, match="leaves no room below ee_upper"):
        box.tightened({"ee_lower": [0, 1, 0]})
    assert HARDWARE.tightened({"ee_lower": [0, 0, 0], "ee_upper": [1, 1, 1]}).ee_upper == (1.0, 1.0, 1.0)


def test_the_arm_whose_limits_they_are_is_no_limit_to_tighten():
    with pytest.raises(LimitWidened, match=r"safety.arm: no such limit"):
        HARDWARE.tightened({"arm": FR3})


@pytest.mark.parametrize(("share", "refused"), [(1.001, False), (0.999, True)])
def test_a_range_too_small_for_the_controllers_two_lines_is_refused(share, refused):
    """Each end keeps the room before which a joint may not move at all."""
    line = control_limits(HARDWARE)[0]
    for joint in range(7):
        lower = list(HARDWARE.q_lower)
        room = float(line["velocity_offset"][joint] ** 2 / line["deceleration"][joint])
        lower[joint] = HARDWARE.q_upper[joint] - share * room
        if refused:
            with pytest.raises(LimitWidened, match=r"safety\.q_lower.* leaves no room below q_upper"):
                HARDWARE.tightened({"q_lower": lower})
        else:
            assert HARDWARE.tightened({"q_lower": lower}).q_lower[joint] == lower[joint]


@given(st.integers(0, 2**31))
def test_the_controllers_lines_are_inside_the_judges_wherever_a_table_draws_them(seed):
    rng = np.random.default_rng(seed)
    limits = HARDWARE.tightened({"dq_max": (HARDWARE.dq_max * rng.uniform(0.001, 1.0, 7)).tolist()})
    line = control_limits(limits)[0]
    room = rng.uniform(0.0, 2.0, 7)
    braked = np.sqrt(2.0 * line["deceleration"] * room) - line["velocity_offset"]
    controllers = np.minimum(line["dq_max"], braked)
    judges = limits.dq_upper(limits.q_upper - room)
    margin = np.minimum(0.02 * FR3.limits.dq_max, np.array(limits.dq_max) / 2)
    assert np.all(line["dq_max"] > 0.0)
    assert np.all((controllers <= judges - margin + 1e-12) | (controllers < 0.0))
    assert np.all((line["tau_max"] < limits.tau_max) & (line["tau_J_max"] < limits.tau_J_max))
    assert line["tau_step"] < limits.tau_rate_max * 1e-3 * (1.0 - 1e-4)


def test_the_controllers_limits_are_the_judges_less_their_margins():
    record = control_limits(HARDWARE, 2e-3)
    assert record.shape == (1,)
    line = record[0]
    braking = np.maximum(FR3.limits.ddq_max, FR3.limits.deceleration)
    for name, wanted in (
        ("q_lower", HARDWARE.q_lower), ("q_upper", HARDWARE.q_upper),
        ("dq_max", 0.96 * FR3.limits.dq_max),
        ("velocity_offset", FR3.limits.velocity_offset + 0.02 * FR3.limits.dq_max),
        ("deceleration", FR3.limits.deceleration), ("braking", braking), ("push_max", 2.0 * braking),
        ("tau_max", 0.999 * FR3.limits.tau_max), ("tau_J_max", 0.9 * FR3.limits.tau_max),
        ("tau_step", 1000.0 * 2e-3 * (1.0 - 2e-4)), ("approach_s", 0.02),
    ):  # fmt: skip
        np.testing.assert_allclose(line[name], wanted, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("room", [-0.1, 0.0, 0.01, 0.1, 0.5, 3.0])
def test_the_fastest_near_a_position_limit_is_the_vendors_formula(room):
    wanted = [
        min(fastest, max(0.0, sqrt(2.0 * deceleration * max(0.0, room)) - offset))
        for fastest, deceleration, offset in zip(
            HARDWARE.dq_max, FR3.limits.deceleration, FR3.limits.velocity_offset, strict=True
        )
    ]
    np.testing.assert_allclose(HARDWARE.dq_upper(np.array(HARDWARE.q_upper) - room), wanted, atol=1e-9)
    np.testing.assert_allclose(HARDWARE.dq_lower(np.array(HARDWARE.q_lower) + room), np.negative(wanted), atol=1e-9)


def _own(by: float, of: np.ndarray) -> OwnLimits:
    """The model's own limits, tighter by a share of `by` in the joints in which `of` is 1, wider where it is -1."""
    arm, share = FR3.limits, by * of
    return OwnLimits(
        arm.q_lower + share, arm.q_upper - share, arm.dq_max - share, arm.tau_max - share,
        arm.velocity_offset + share, arm.deceleration - share,
    )  # fmt: skip


def test_of_the_models_limits_and_the_robots_own_the_tighter_one_holds():
    of = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    limits, differs = within_own(HARDWARE, _own(0.05, of))
    assert len(differs) == 6 * 7
    first = FR3.limits.q_lower[0]
    assert differs[0] == f"q_lower of joint 1 is {first + 0.05:g} rad, described as {first:g}"
    tighter, arm = 0.05 * np.maximum(of, 0.0), FR3.limits
    for found, wanted in (
        (limits.q_lower, arm.q_lower + 0.005 + tighter), (limits.q_upper, arm.q_upper - 0.005 - tighter),
        (limits.dq_max, 0.98 * (arm.dq_max - tighter)), (limits.tau_max, arm.tau_max - tighter),
        (limits.tau_J_max, arm.tau_max - tighter), (limits.arm.velocity_offset, arm.velocity_offset + tighter),
        (limits.arm.deceleration, arm.deceleration - tighter),
    ):  # fmt: skip
        np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_own_limits_that_differ_as_a_file_rounds_are_those_of_the_model():
    for by, differ in ((0.0, 0), (0.9e-4, 0), (1.1e-4, 42)):
        for of in (np.ones(7), -np.ones(7)):
            limits, said = within_own(HARDWARE, _own(by, of))
            assert len(said) == differ
            assert differ or limits == HARDWARE
    for name in ("velocity_offset", "deceleration"):  # both or none: one alone is no velocity limit
        limits, _ = within_own(HARDWARE, replace(_own(0.05, np.ones(7)), **{name: None}))
        assert limits.arm == HARDWARE.arm


def test_an_unknown_limit_is_refused_with_those_that_there_are():
    with pytest.raises(LimitWidened, match=r"safety.dq_maximum: no such limit; there are arm_distance_min, dq_max"):
        HARDWARE.tightened({"dq_maximum": 1.0})


@given(st.lists(st.tuples(st.sampled_from(["power_max", "arm_distance_min", "ee_speed_max"]), st.floats(-1, 2000))))
def test_no_chain_of_tables_ever_widens(tables):
    limits = HARDWARE
    for name, value in tables:
        before = getattr(limits, name)
        try:
            limits = limits.tightened({name: value})
        except LimitWidened:
            assert getattr(limits, name) == before
            continue
        assert limits.arm_distance_min >= HARDWARE.arm_distance_min
        assert limits.power_max <= HARDWARE.power_max
        assert getattr(limits, name) == value
        assert (value >= before) if name == "arm_distance_min" else (value <= before)


def test_nothing_writes_to_limits_afterwards():
    with pytest.raises(FrozenInstanceError):
        HARDWARE.power_max = 1e9  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        SafetyJudge()._rules["power_max"] = 1e9


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_a_base_or_a_tool_that_is_nowhere_is_refused(bad):
    """Where a place is not a number, no line is ever crossed."""
    for i in range(3):
        place, size = [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]
        place[i] = size[i] = bad
        with pytest.raises(ValueError, match=r"base_position = .*must be finite"):
            Base(tuple(place))
        for length in (bad, 0.0, -0.1):
            size[i] = length
            with pytest.raises(ValueError, match=r"size = .*must be positive and finite"):
                Tool(tuple(size))
    for wxyz in ((bad, 0, 0, 0), (0, 0, 0, bad), (0, 0, 0, 0), (0, 1e-6, 0, 0)):
        with pytest.raises(ValueError, match=r"base_orientation_wxyz = .*not a quaternion"):
            Base((0, 0, 0), wxyz)
    with pytest.raises(ValueError, match=r"flange_to_face = .*must be finite"):
        Tool(flange_to_face=bad)
    assert Base((0, 0, 0), (0, 2e-6, 0, 0)).position == (0, 0, 0)
    assert Tool((5e-324,) * 3, -1.0).size == (5e-324,) * 3
