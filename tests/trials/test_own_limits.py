"""The limits that a robot tells of itself: compared with its model, and the tighter ones hold."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hal.errors import HardwareError
from hal.fci import ask_for_urdf, limits_in
from hal.limits import OwnLimits
from hal.robots import FER, FR3
from rtstack.cells import open_cell
from rtstack.safety.limits import HARDWARE, control_limits, within_own
from rtstack.trials.errors import TrialError
from rtstack.trials.tightening import check_models, difference_of_limits, limits_of_arms, limits_of_cell
from sim_robot.cell import simulated_cell
from sim_robot.scene import NO_OBJECT

NAMES = ("q_lower", "q_upper", "dq_max", "tau_max", "velocity_offset", "deceleration")


def own(**changes: tuple[int, float]) -> OwnLimits:
    """The model's own limits, with changes: name = (joint 1 to 7, by how much)."""
    values = {name: getattr(FR3.limits, name).copy() for name in NAMES}
    for name, (joint, by) in changes.items():
        values[name][joint - 1] += by
    return OwnLimits(**values)


def test_a_robot_as_described_changes_nothing(cell):
    assert within_own(HARDWARE, own()) == (HARDWARE, ())
    assert difference_of_limits(cell, (own(), own())) == ""
    assert difference_of_limits(cell, None) == ""


@pytest.mark.parametrize(
    ("name", "by", "holds"),
    [
        ("q_lower", 0.1, True), ("q_lower", -0.1, False), ("q_upper", -0.1, True), ("q_upper", 0.1, False),
        ("dq_max", -0.2, True), ("dq_max", 0.2, False), ("tau_max", -7.0, True), ("tau_max", 7.0, False),
    ],
)  # fmt: skip
def test_the_tighter_one_holds_and_what_differs_is_said(cell, name, by, holds):
    limits, said = within_own(HARDWARE, own(**{name: (3, by)}))
    assert len(said) == 1
    assert said[0].startswith(f"{name} of joint 3 is ")
    before, now = np.array(getattr(HARDWARE, name)), np.array(getattr(limits, name))
    changed = by * (0.98 if name == "dq_max" else 1.0)
    np.testing.assert_allclose(now - before, [0.0, 0.0, changed if holds else 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    line = difference_of_limits(cell, (own(), own(**{name: (3, by)})))
    assert line.startswith("the robots' own limits differ, and the tighter ones hold: right: ")
    assert "\n" not in line


@pytest.mark.parametrize(
    ("name", "by", "holds"),
    [("velocity_offset", 0.1, True), ("velocity_offset", -0.1, False), ("deceleration", -1.0, True),
     ("deceleration", 1.0, False)],
)  # fmt: skip
def test_the_tighter_velocity_limit_near_a_position_limit_holds(cell, name, by, holds):
    its = own(**{name: (3, by)})
    limits, said = within_own(HARDWARE, its)
    unit = "rad/s" if name == "velocity_offset" else "rad/s^2"
    mine = getattr(FR3.limits, name)[2]
    assert said == (f"{name} of joint 3 is {mine + by:g} {unit}, described as {mine:g}",)
    assert said[0] in difference_of_limits(cell, (own(), its))
    np.testing.assert_allclose(getattr(limits.arm, name), getattr(its if holds else FR3.limits, name))
    near = np.array(HARDWARE.q_upper) - 0.2  # where the limit falls
    slower = limits.dq_upper(near) < HARDWARE.dq_upper(near)  # the judge's
    assert slower.tolist() == [False, False, holds, False, False, False, False]
    assert control_limits(limits)[name][0, 2] - control_limits(HARDWARE)[name][0, 2] == pytest.approx(by * holds)


def test_a_robot_that_reports_no_velocity_limit_near_a_position_limit_keeps_the_models():
    bare = OwnLimits(*(getattr(FR3.limits, name) for name in NAMES[:4]))
    assert within_own(HARDWARE, bare) == (HARDWARE, ())
    law = r"<position_based_velocity_limits [^>]*>"
    for urdf in (re.sub(law, "", FR3.urdf), FER.urdf):
        limits = limits_in(urdf, "it")
        assert limits.velocity_offset is None
        assert limits.deceleration is None


def test_the_limits_of_a_run_are_inside_the_robots(cell):
    arms = replace(simulated_cell(NO_OBJECT, 0.0, 0).as_cell("direct"), own_limits=(own(), own(q_upper=(4, -0.3))))
    left, right = limits_of_cell(limits_of_arms(cell), arms)
    assert left == limits_of_arms(cell)[0]
    assert right.q_upper[3] == pytest.approx(left.q_upper[3] - 0.3)


def test_an_arm_of_another_model_is_refused(cell):
    check_models(cell, (own(), own(q_lower=(3, 0.01))))
    check_models(cell, (own(), own(q_upper=(4, -0.05))))  # nearer to no other model
    check_models(cell, None)
    panda = OwnLimits(*(getattr(FER.limits, name) for name in NAMES[:4]))
    with pytest.raises(TrialError, match=r"the right arm has .* of .*Panda.*model 'fr3'.*\[right\] model"):
        check_models(cell, (own(), panda))
    described = replace(cell, left=replace(cell.left, model="fer"))
    with pytest.raises(TrialError, match=r"the left arm has the joint limits of Franka Research 3.*model 'fer'"):
        check_models(described, (own(), own()))


def test_a_robot_is_asked_when_it_is_connected_to(served_arms):
    urdf = ask_for_urdf(served_arms.left)
    for name in NAMES:
        np.testing.assert_allclose(getattr(limits_in(urdf, "it"), name), getattr(FR3.limits, name), atol=1e-9)
    arms = open_cell(served_arms.cell, "rice_box", 0.0, 0, served_arms.description)
    try:
        assert arms.warning == ""
        assert arms.own_limits is not None
        np.testing.assert_allclose(arms.own_limits[1].dq_max, FR3.limits.dq_max, atol=1e-9)
        assert np.isfinite(arms.left.read().q).all()
    finally:
        arms.close()


def test_nonsense_is_one_line():
    urdf = FR3.urdf
    law = re.compile(r"<position_based_velocity_limits [^>]*>")
    worse = [re.sub('velocity_offset="[^"]*"', f'velocity_offset="{value}"', urdf) for value in ("nan", "-0.3", "9.0")]
    worse += [
        re.sub('deceleration_limit="[^"]*"', f'deceleration_limit="{x}"', urdf) for x in ("nan", "-1", "0", "inf")
    ]
    for bad in (
        "<robot", "<robot/>", re.sub('upper="', 'upper="x', urdf), urdf.replace("velocity=", "speed="),
        law.sub("", urdf, count=1), urdf.replace("deceleration_limit", "deceleration"), *worse,
    ):  # fmt: skip
        with pytest.raises(HardwareError, match="the model that it tells") as refused:
            limits_in(bad, "it")
        assert "\n" not in str(refused.value)
    with pytest.raises(HardwareError, match="does not answer"):
        ask_for_urdf("127.0.99.96")
