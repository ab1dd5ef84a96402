"""Where the object is after each kind of end, in the simulation: how far it has fallen, and what the other arm did."""

from dataclasses import replace

import numpy as np
import pytest

from hal.robot_errors import error_bit, error_names
from rtstack.loop.end import End
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.model.cell_description import CellDescription, LoadPolicy
from rtstack.trials.move import HELD_AFTER, settle_load
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.faults.file import faults_in
from tests.support.plant_object import object_pose

OBJECT = "rice_box"
CARRIED_TICKS = 3300  # of the shared demonstration: the object is in the air
AFTER_TICKS = 2000
FALLEN_M = 3e-3


class Act:
    """A watchdog that does something in one tick, and trips if that says so; a stop signal, once it is told."""

    def __init__(self, act=None) -> None:
        self._act, self.tick, self.stop_requested = act, 0, False

    def trip(self):
        self.tick += 1
        return self._act(self) if self.tick == CARRIED_TICKS else None


def height(plant: SimulatedCell, cell: CellDescription) -> float:
    """How far the object's lower face is above the table, m."""
    place, _ = object_pose(plant.plant)
    return place[2] - cell.objects[OBJECT].size[2] / 2.0 - cell.table.top_z


@pytest.fixture
def carried(cell, demonstration):
    """Run a trial in which something happens while the object is carried; give plant, heights then and now, result."""

    def run(happens, policy: LoadPolicy = LoadPolicy.HOLD, *faults):
        described = replace(cell, load_after_stop=policy)
        plant = simulated_cell(OBJECT, 0.0, 0, faults=faults_in({"fault": list(faults)}, ""))
        heights = []

        def act(watch: Act) -> WatchdogTrip | None:
            heights.append(height(plant, cell))
            return happens(watch, plant)

        watch = Act(act)
        prepared = prepare_trial(TrialSpecification(str(demonstration.path)), described)
        result = run_trial(prepared, plant.as_cell("direct"), RunContext(stop=watch, watchdogs=(watch,)))
        pads = [np.array(arm["O_T_EE"][:3, 3]) for arm in plant.states]
        for _ in range(AFTER_TICKS):
            plant.next_state()
        moved = [float(np.linalg.norm(arm["O_T_EE"][:3, 3] - pad)) for arm, pad in zip(plant.states, pads, strict=True)]
        after = height(plant, cell)
        said = result.failure_reason or "success"
        print(f"{said} ({policy}): {1e3 * heights[0]:.0f} mm above the table, 2 s later {1e3 * after:.0f} mm")
        return plant, heights[0], after, result, moved

    return run


def of_the_operator(watch: Act, _plant: SimulatedCell) -> None:
    watch.stop_requested = True


def reflex(_watch: Act, plant: SimulatedCell) -> None:
    plant.boxes[0].trip(error_bit("joint_reflex"))


@pytest.mark.parametrize("policy", LoadPolicy)
def test_after_a_success_it_stands_on_the_table(carried, cell, policy):
    _, before, after, result, _ = carried(lambda *_: None, policy)
    assert result.success
    assert before > 0.1
    assert abs(after) < FALLEN_M


@pytest.mark.parametrize("policy", LoadPolicy)
def test_after_a_persons_stop_it_is_held_where_it_is_whatever_the_policy(carried, policy):
    _, before, after, result, _ = carried(of_the_operator, policy)
    assert "stop requested" in result.failure_reason
    assert before > 0.1
    assert after == pytest.approx(before, abs=0.02)  # it was moving


@pytest.mark.parametrize("policy", LoadPolicy)
def test_after_a_reflex_of_one_arm_both_hold_it_and_the_other_arm_does_not_push(carried, policy):
    _, before, after, result, moved = carried(reflex, policy)
    assert "reflex" in result.failure_reason
    assert after == pytest.approx(before, abs=0.02)
    assert max(moved) < 5e-3  # m, within two seconds


def test_after_a_lost_process_the_robots_hold_it(cell, demonstration):
    """No answer comes any more: after 20 states without one each robot stops by itself."""

    plant = simulated_cell(OBJECT, 0.0, 0)

    class Killed:
        tick = 0

        def trip(self):
            self.tick += 1
            if self.tick == CARRIED_TICKS:
                raise KeyboardInterrupt  # no exception that a session catches

    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
    arms = plant.as_cell("direct")
    for arm in (plant.left, plant.right):
        arm.stop = lambda: None
    with pytest.raises(KeyboardInterrupt):
        run_trial(prepared, arms, RunContext(watchdogs=(Killed(),)))
    before = height(plant, cell)
    for _ in range(AFTER_TICKS):
        plant.next_state()
    assert before > 0.1
    assert height(plant, cell) == pytest.approx(before, abs=0.02)
    assert {name for box in plant.boxes for name in error_names(box.errors)} == {"communication_constraints_violation"}


# a value that is no number, for one tick: the judge stops
NO_NUMBER = {"kind": "state_nan", "arm": "left", "at_s": 3.3, "duration_s": 0.001, "field": "O_F_ext_hat_K"}


@pytest.mark.parametrize(
    ("policy", "falls"), [(LoadPolicy.HOLD, False), (LoadPolicy.LOWER, True), (LoadPolicy.RELEASE, True)]
)
def test_after_the_judges_stop_the_cells_file_decides(carried, policy, falls):
    plant, _, after, result, _ = carried(lambda *_: None, policy, NO_NUMBER)
    assert "not finite" in result.failure_reason
    assert (abs(after) < 2.0 * FALLEN_M) == falls
    forces = [np.linalg.norm(state["O_F_ext_hat_K"][:3]) for state in plant.states]
    assert (max(forces) < 3.0) == falls  # neither pad touches it any more


def raises(_watch: Act, _plant: SimulatedCell) -> None:
    raise RuntimeError("a defect of the loop's own")


def trips(end: End):
    return lambda *_: WatchdogTrip(end, "")


USER_STOP = {"kind": "user_stop", "arm": "left", "at_s": CARRIED_TICKS * 1e-3}
TRIPS = (
    End.NO_IMPACT, End.UNEXPECTED_IMPACT, End.CRASH, End.CONSOLE_GONE, End.OPERATOR_GONE, End.RELEASED,
    End.CLUTCH_QUIET, End.PARENT_GONE, End.LOG_FAILED, End.TICK_OVERRUN,
    End.TORQUE_NOT_TAKEN,
)  # fmt: skip
# what ends it, whether the cell's file decides then, and the plant's fault
ENDS = {end.name: (trips(end), end not in HELD_AFTER, ()) for end in TRIPS} | {
    "CONTROLLER_EXCEPTION": (raises, True, ()),
    "user stop of one robot": (lambda *_: None, False, (USER_STOP,)),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("end", "policy"),
    # where the cell's file does not decide, the object is held even under the policy that would let it fall
    [(end, policy) for end in ENDS for policy in (LoadPolicy if ENDS[end][1] else (LoadPolicy.RELEASE,))],
)
def test_after_each_kind_of_end_it_is_held_or_put_where_the_cells_file_says(carried, end, policy):
    happens, decides, faults = ENDS[end]
    _, before, after, result, _ = carried(happens, policy, *faults)
    assert not result.success
    assert before > 0.1
    if decides and policy is not LoadPolicy.HOLD:
        assert abs(after) < 2.0 * FALLEN_M
    else:
        assert after == pytest.approx(before, abs=0.02)


def test_an_end_in_which_something_was_hit_moves_nothing(cell):
    plant = simulated_cell(OBJECT, 0.0, 0)
    described = replace(cell, load_after_stop=LoadPolicy.LOWER)
    for end in (End.CRASH, End.HARDWARE, End.STOP_REQUESTED, End.COMPLETED, End.OPERATOR_GONE):
        assert settle_load(described, OBJECT, RunContext(), plant.as_cell("direct"), end) == ""
    said = settle_load(described, OBJECT, RunContext(), plant.as_cell("direct"), End.SAFETY)
    assert said == "the load stays as it is: nothing is held between the pads: there is nothing to put down"
