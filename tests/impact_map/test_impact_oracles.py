"""A sample of the oracles' random configurations, and what follows a grab's single time step."""

import pytest

from rtstack.experiments.registry import plan_file
from rtstack.papers.impact_maps.plan import load_validation_plan
from rtstack.planning import plan_grab
from rtstack.references.motion import Motion
from tests.programs.impact_oracles import Tally, check_configuration
from tests.programs.impact_sequence import PLAN, plant, steps, upwards

SAMPLES, BATCH = 60, 15


@pytest.mark.parametrize("first", range(0, SAMPLES, BATCH))
def test_every_oracle_agrees_with_the_map(first):
    tally = Tally()
    for seed in range(10_000 + first, 10_000 + first + BATCH):
        check_configuration(seed, tally)
    assert tally.failures == []
    assert tally.worst["mujoco: frictionless"] > 0.0  # it was asked


@pytest.fixture(scope="module")
def planned(cell):
    """A grab of the validation's plan."""
    scenario = load_validation_plan(plan_file(PLAN).path).scenario(Motion.GRAB)
    return plan_grab(cell, "box_130", scenario.request("1", 1.0, True))


def test_further_steps_lead_from_the_single_step_to_the_converged_map_where_the_pads_are_squeezed(planned):
    problem, count = planned.map.problem, 120
    single, converged = (upwards(problem, one.velocity) for one in (planned.map.single_step, planned.map.converged))
    assert single < 0.97 * converged
    free, closed = steps(problem, 0.0, 3)
    assert free == pytest.approx([single] * 3, abs=1e-9)  # nothing closes the corners: a further step adds nothing
    assert closed == 3
    squeezed, closed = steps(problem, planned.request.squeeze, count)
    assert 10 < closed < count
    assert squeezed[0] == pytest.approx(single, rel=0.01)
    assert squeezed[-1] == pytest.approx(converged, rel=1e-6)


def test_a_plant_with_separate_corners_ends_near_the_converged_map(planned):
    problem, request = planned.map.problem, planned.request
    single, converged = (upwards(problem, one.velocity) for one in (planned.map.single_step, planned.map.converged))
    for late_m in (0.0, 1e-3):
        end = plant(problem, request.give, 1.3, request.squeeze, late_m=late_m)
        assert abs(end - converged) < 0.5 * abs(end - single)
