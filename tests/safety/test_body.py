"""The judge's picture of an arm and its rules: what is computed once, from the description and the limits."""

import numpy as np
import pinocchio as pin
import pytest

from hal.robots import FR3
from rtstack.safety.body import Base, Tool, _turn, arm_body
from rtstack.safety.limits import HARDWARE
from rtstack.safety.records import StopProfile, empty_memory, rules
from tests.support.safety.judge_oracle import CAPSULES, DH


def test_a_turn_is_urdf_s_roll_pitch_and_yaw():
    for rpy in np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3)):
        np.testing.assert_allclose(_turn(rpy), pin.rpy.rpyToMatrix(*rpy), atol=1e-12)


def test_the_capsules_are_those_of_the_description_and_reach_to_their_furthest_point():
    body = arm_body(Base(), Tool())
    assert body["first"].tolist() == [0, 1, 2, 3, 4, 5, 7, 8, 10]
    flange = np.array([0.0, 0.0, 0.107])
    for k, (link, a, b, radius) in enumerate(CAPSULES):
        ends = {tuple(np.round(end - (flange if link == 8 else 0.0), 9)) for end in body["ends"][k]}
        assert ends == {tuple(np.round(np.array(end, dtype=float), 9)) for end in (a, b)}
        assert body["radius"][k] == pytest.approx(radius)
        assert body["reach"][k] == pytest.approx(radius + np.linalg.norm(np.subtract(a, b)) / 2)


def test_a_base_stands_upright_at_the_origin_unless_told_otherwise():
    assert Base() == Base((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert Tool() == Tool((0.1, 0.1, 0.03), 0.03, (0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    np.testing.assert_array_equal(arm_body(Base(), Tool())["base_rotation"], np.eye(3))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("offset_xy", (np.nan, 0.0)), ("offset_xy", (0.0, np.inf)), ("orientation_wxyz", (0.0, 0.0, 0.0, 0.0)),
        ("orientation_wxyz", (1e-6, 0.0, 0.0, 0.0)), ("orientation_wxyz", (np.inf, 0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_a_pad_that_stands_nowhere_is_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Tool(**{field: value})
    assert Tool(orientation_wxyz=(2e-6, 0.0, 0.0, 0.0)).offset_xy == (0.0, 0.0)


def test_joints_and_face_are_where_the_published_table_says():
    body = arm_body(Base(), Tool(flange_to_face=0.05))
    for i, (a, d, alpha) in enumerate(DH[:7]):
        T = pin.SE3(pin.rpy.rpyToMatrix(alpha, 0.0, 0.0), np.array([a, -d * np.sin(alpha), d * np.cos(alpha)]))
        np.testing.assert_allclose(body["translation"][i], T.translation, atol=1e-9)
        np.testing.assert_allclose(body["rotation"][i], T.rotation, atol=1e-9)
    np.testing.assert_allclose(body["face"], [0.0, 0.0, 0.107 + 0.05], atol=1e-12)


def test_a_pad_is_inside_its_capsule_whatever_its_shape():
    for size in ((0.1, 0.1, 0.03), (0.04, 0.2, 0.3), (0.3, 0.02, 0.5)):
        body = arm_body(Base(), Tool(size, 0.4))
        pad = int(body["first"][-1]) - 1
        a, b = body["ends"][pad]
        corners = np.array(np.meshgrid(*([-s / 2, s / 2] for s in size))).reshape(3, -1).T
        for corner in corners + [0.0, 0.0, 0.107 + 0.4 - size[2] / 2]:
            along = np.clip((corner - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            assert np.linalg.norm(corner - a - along * (b - a)) == pytest.approx(body["radius"][pad])


def test_the_rules_are_one_record_that_nobody_writes_to():
    record = rules(HARDWARE, StopProfile(), arm_body(Base(), Tool()))
    assert record.shape == (1,)
    with pytest.raises(ValueError, match="read-only"):
        record["power_max"] = 1e9
    with pytest.raises(ValueError, match="read-only"):
        record[0]["q_upper"][3] = 9.0
    rule = record[0]
    assert (rule["dt"], rule["reaction"], rule["hold_share"]) == (1e-3, 2e-3, pytest.approx(0.05))
    assert rule["tau_step"] == pytest.approx(0.9999)
    assert (rule["gap_max_ns"], rule["skew_max_ns"]) == (20_000_000, 20_000_000)
    np.testing.assert_array_equal(rule["velocity_offset"], FR3.limits.velocity_offset)
    np.testing.assert_array_equal(rule["deceleration"], FR3.limits.deceleration)


def test_an_empty_memory_has_a_record_an_arm():
    assert empty_memory(2).shape == (2,)
    assert not empty_memory(1).view(np.uint8).any()
