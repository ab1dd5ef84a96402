"""Guide mode: a simulated hand moves each joint from beyond each of its limits, and the judge keeps the last word."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from rtstack.cells import load_description
from rtstack.control.guiding import INSIDE_RAD_S
from rtstack.loop.end import End
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.model.cell_description import CellDescription
from rtstack.safety.guided import FURTHER_M, FURTHER_RAD, beyond, guided_limits, outside_robot
from rtstack.samples import SIDES, Level
from rtstack.trials.move import PreparedGuide, where_arms_stand
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import GuideSpecification
from rtstack.trials.tightening import limits_of_arms
from sim_robot.cell import SimulatedCell, simulated_cell
from tests.support.sampling import sampled

BEYOND = 0.1  # rad, that a test's cell is narrower than where the arm stands
RISE_MS = 500  # how long a hand takes to its full push
PUSH_NM = (12.0, 12.0, 12.0, 12.0, 2.0, 2.0, 1.0)
INSIDE = 0.03  # rad or m: a hand that has the arm so far inside lets go


RAISED = 0.25  # rad, of joint 2: at home the pads are 10 mm above the table


@pytest.fixture
def cell() -> SimulatedCell:
    """Arms that hold their pads high enough for a hand to move them every way."""
    made = simulated_cell("none", 0.0, 3)
    homes = [made.states[side]["q"].copy() for side in (0, 1)]
    for k in range(700):
        for side, home in enumerate(homes):
            q = home - RAISED * min(1.0, k / 600) * np.eye(7)[1]
            made.plant.track(side, q, np.zeros(7))
        made.next_state()
    return made


@pytest.fixture
def description() -> CellDescription:
    return load_description(None)[0]


@dataclass
class Hand:
    """Pushes a joint of the left arm (Nm), or its pad (N), as a watchdog of the session, until `done`."""

    cell: SimulatedCell
    torque: np.ndarray = field(default_factory=lambda: np.zeros(7))
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    done: Callable[[], bool] = lambda: False
    lets_go: bool = True
    ticks: int = 0
    q: list = field(default_factory=list)
    face: list = field(default_factory=list)

    def trip(self) -> WatchdogTrip | None:
        self.ticks += 1
        self.q.append(self.cell.states[0]["q"].copy())
        self.face.append(self.cell.sensors.kinematics[0]["T"][:3, 3].copy())
        share = min(1.0, self.ticks / RISE_MS)
        if self.done() and self.lets_go:
            self.cell.plant.motors[0]["tau_applied"] = 0.0
            return WatchdogTrip(End.RELEASED, "", Level.INFO)
        if self.force.any():
            self.cell.plant.push(0, share * self.force)
        else:
            self.cell.plant.motors[0]["tau_applied"] = share * self.torque
        return None

    def fastest(self, joint: int, ticks: int) -> float:
        """The largest mean speed over 0.2 s, rad/s, in the first ticks, once the full push has pressed the spring."""
        q = np.array(self.q)[RISE_MS + 600 : ticks, joint]
        return float(np.abs(q[200:] - q[:-200]).max() / 0.2)


def narrowed(description: CellDescription, cell: SimulatedCell, joint: int, sign: int) -> CellDescription:
    """Return the cell with a limit of this joint that the left arm is BEYOND; sign: of the way further out."""
    q = cell.states[0]["q"]
    safety = dict(description.safety)
    limits = limits_of_arms(description)[0]
    low, high = list(limits.q_lower), list(limits.q_upper)
    if sign > 0:
        high[joint] = q[joint] - BEYOND
    else:
        low[joint] = q[joint] + BEYOND
    return replace(description, safety={**safety, "q_lower": low, "q_upper": high})


def of_left(lines: tuple[str, ...]) -> list[str]:
    return [line for line in lines if line.startswith("left")]


@pytest.mark.parametrize("sign", [-1, 1], ids=["lower", "upper"])
@pytest.mark.parametrize("joint", sampled(range(7), lambda joint: joint in (0, 3, 6)))
def test_a_hand_leads_a_joint_back_from_beyond_its_limit_slowly(cell, description, joint, sign):
    own = narrowed(description, cell, joint, sign)
    hand = Hand(cell, torque=-sign * PUSH_NM[joint] * np.eye(7)[joint])
    edge = cell.states[0]["q"][joint] - sign * BEYOND
    hand.done = lambda: sign * (edge - cell.states[0]["q"][joint]) > INSIDE
    result = PreparedGuide(GuideSpecification(8.0), own).run(cell.as_cell("direct"), RunContext(watchdogs=(hand,)))
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    assert [line.split(":")[0] for line in of_left(result.beyond_before)] == [f"left arm, joint {joint + 1}"]
    assert of_left(result.beyond_after) == []
    outside = sum(sign * (q[joint] - edge) > 0.0 for q in hand.q)
    assert 0.8 * INSIDE_RAD_S < hand.fastest(joint, outside) < 1.05 * INSIDE_RAD_S


@pytest.mark.parametrize("sign", [-1, 1], ids=["lower", "upper"])
@pytest.mark.parametrize("joint", sampled(range(7), lambda joint: joint in (0, 3, 6)))
def test_a_hand_that_pushes_further_out_meets_a_spring_and_then_the_judge(cell, description, joint, sign):
    own = narrowed(description, cell, joint, sign)
    began = cell.states[0]["q"].copy()
    hand = Hand(cell, torque=sign * 4.0 * PUSH_NM[joint] * np.eye(7)[joint])
    result = PreparedGuide(GuideSpecification(4.0), own).run(cell.as_cell("direct"), RunContext(watchdogs=(hand,)))
    assert not result.success
    assert result.failure_reason is not None
    assert result.failure_reason.startswith("safety stop")
    assert sign * (np.array(hand.q)[:, joint] - began[joint]).max() < FURTHER_RAD + 0.005


def test_an_arm_that_no_hand_touches_stays_where_it_is_beyond_its_limit(cell, description):
    own = narrowed(description, cell, 1, 1)
    hand = Hand(cell)
    result = PreparedGuide(GuideSpecification(2.0), own).run(cell.as_cell("direct"), RunContext(watchdogs=(hand,)))
    assert result.success
    assert len(result.beyond_after) == len(result.beyond_before) == 2
    assert np.abs(np.array(hand.q) - hand.q[0])[:, 1].max() < 0.005


# not the upper z: the table is below
@pytest.mark.parametrize(("axis", "sign"), [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1)])
def test_a_hand_leads_a_pad_back_into_its_box(cell, description, axis, sign):
    where = where_arms_stand(description, cell.as_cell("direct"))
    face = where.face[0]
    safety = dict(description.safety)
    low, high = list(safety["ee_lower"]), [0.2, 0.7, 0.75]
    if sign < 0:
        low[axis] = face[axis] + 0.05
    else:
        high[axis] = face[axis] - 0.05
    own = replace(description, safety={**safety, "ee_lower": low, "ee_upper": high})
    hand = Hand(cell, force=-sign * 30.0 * np.eye(3)[axis])
    edge = face[axis] - sign * 0.05
    offset = cell.sensors.kinematics[0]["T"][:3, 3][axis] - face[axis]
    hand.done = lambda: sign * (edge + offset - cell.sensors.kinematics[0]["T"][:3, 3][axis]) > 0.01
    result = PreparedGuide(GuideSpecification(8.0), own).run(cell.as_cell("direct"), RunContext(watchdogs=(hand,)))
    assert (result.success, result.failure_reason) == (True, None)
    assert any(f"left pad, {'xyz'[axis]}" in line for line in result.beyond_before)
    assert of_left(result.beyond_after) == []
    out = hand.face[0][axis] + sign * (FURTHER_M + 0.002)
    assert all(sign * (place[axis] - out) < 0.0 for place in hand.face)


def test_an_arm_inside_its_limits_is_free_and_comes_to_rest_by_itself(cell, description):
    hand = Hand(cell, torque=np.array([10.0, 0, 0, 0, 0, 0, 0]))
    hand.done = lambda: hand.ticks > 400
    hand.lets_go = False
    began = cell.states[0]["q"][0]

    class Later:
        def trip(self) -> None:
            if hand.ticks > 400:
                hand.torque = np.zeros(7)

    result = PreparedGuide(GuideSpecification(2.0), description).run(
        cell.as_cell("direct"), RunContext(watchdogs=(hand, Later()))
    )
    assert result.success
    assert cell.states[0]["q"][0] - began > 0.02
    assert abs(cell.states[0]["dq"][0]) < 0.02


def test_the_limits_of_a_guided_arm_are_never_wider_but_where_it_stands(cell, description):
    limits = limits_of_arms(description)
    inside = where_arms_stand(description, cell.as_cell("direct"))
    guided = guided_limits(limits, inside)
    assert beyond(limits, inside, SIDES) == ()
    for own, hand, face in zip(limits, guided, inside.face, strict=True):
        assert hand.q_lower == own.q_lower
        assert hand.q_upper == own.q_upper
        assert max(hand.dq_max) <= 0.6
        assert hand.ee_speed_max <= 0.25
        assert max(hand.tau_ext_max) <= 0.5 * max(own.tau_ext_max)
        assert np.all(np.array(hand.ee_lower) >= np.minimum(own.ee_lower, face - FURTHER_M))


def test_a_joint_at_the_robot_s_own_limit_is_left_to_desk(description, cell):
    limits, where = limits_of_arms(description), where_arms_stand(description, cell.as_cell("direct"))
    assert outside_robot(limits, where, SIDES) == ""
    where.q[0, 3] = limits[0].arm.q_lower[3]
    assert outside_robot(limits, where, SIDES).startswith("left arm, joint 4: -3.0481 rad, the robot's own limits")


def test_arms_that_are_too_close_are_led_apart(description, cell):
    near = replace(description, safety={**description.safety, "arm_distance_min": 0.9})
    hand = Hand(cell, force=np.array([0.0, 10.0, 0.0]))
    hand.done = lambda: cell.sensors.kinematics[0]["T"][1, 3] - hand.face[0][1] > 0.03
    before = where_arms_stand(near, cell.as_cell("direct")).distance
    result = PreparedGuide(GuideSpecification(6.0), near).run(cell.as_cell("direct"), RunContext(watchdogs=(hand,)))
    assert result.success
    assert "the arms are" in result.beyond_before[0]
    assert where_arms_stand(near, cell.as_cell("direct")).distance > before
