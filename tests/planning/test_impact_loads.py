"""What an impact does to the joints belongs to the feasibility of a plan. The figures are of trials that failed."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.cells import default_cell_file
from rtstack.cli.app import app
from rtstack.log.reader import read_log
from rtstack.planning import GrabPlan, TooFast, plan_grab
from rtstack.planning.feasibility import check_loads
from rtstack.planning.file import write_plan
from rtstack.planning.grab import grab_motion
from rtstack.planning.impact_loads import impact_loads
from rtstack.trials.record import open_log
from rtstack.trials.review import log_columns
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import simulated_cell


def heavier(cell, name, mass):
    """Return the cell with an object of another mass, kg."""
    return replace(cell, objects={**cell.objects, name: replace(cell.objects[name], mass=mass)})


@pytest.mark.parametrize(
    ("name", "asked", "said"),
    [
        # 0 of 5 trials succeeded: the judge's momentum residual
        ("box_060", {"speed": 0.7}, r"the momentum residual of joint [13] to \d+\.\d Nm, 95.0 are allowed"),
        # 15 of 20: tau_j_range_violation
        ("bottles", {"speed": 0.7}, r"the torque of joint 6 to \d+\.\d Nm, 10.8 are allowed \(0.9 of 12\)"),
    ],
)
def test_an_impact_that_a_limit_does_not_allow(cell, name, asked, said):
    with pytest.raises(
        TooFast, match=said + r".*; all else as it is, the fastest speed that would do is 0\.\d\d m/s"
    ) as caught:
        plan_grab(cell, name, GrabPlan(**asked))
    fastest = caught.value.fastest
    assert fastest is not None
    assert 0.3 < fastest < asked["speed"]
    planned = plan_grab(cell, name, GrabPlan(**{**asked, "speed": fastest}))
    assert planned.request.speed == fastest


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"tau_ext_max": [40.0] * 7}, r"momentum residual of joint 1 to .*, 38.0 are allowed \(0.95 of 40\)"),
        ({"dq_max": [2.0] * 5 + [1.6, 2.0]}, r"velocity of joint 6 to .* rad/s, 1.4 are allowed \(0.9 of 1.6\)"),
        ({"power_max": 20.0}, r"its power to .* W, 12.0 are allowed \(0.6 of 20\)"),
    ],
)
def test_a_limit_that_the_cell_tightens(cell, limits, said):
    planned = grab_motion(cell, "rice_box", GrabPlan(speed=0.4))
    check_loads(planned, cell)
    with pytest.raises(TooFast, match=said):
        check_loads(planned, replace(cell, safety={**cell.safety, **limits}))


def test_an_impact_is_harder_on_a_harder_object_and_at_a_higher_speed(cell):
    def residual(speed: float, give: float) -> float:
        planned = grab_motion(cell, "box_130", GrabPlan(speed=speed))
        return float(impact_loads(planned, give, 1.3)["left"].external[0])

    assert residual(0.3, 2e-5) > residual(0.3, 5e-5)
    # the contact is linear as long as the object does not slip: twice the speed, twice the torque
    assert residual(0.6, 2e-5) == pytest.approx(2.0 * residual(0.3, 2e-5), rel=0.1)


@pytest.mark.parametrize(
    ("name", "speed", "rise"), [("box_130", 0.5, 0.25), pytest.param("parcel", 0.4, 0.2, marks=pytest.mark.long)]
)
def test_what_is_predicted_is_what_a_trial_measures(cell, tmp_path, name, speed, rise):
    planned = plan_grab(cell, name, GrabPlan(speed=speed, rise=rise, height=0.02))
    predicted = impact_loads(planned, cell.objects[name].give, cell.objects[name].mass)
    path, log = tmp_path / "plan.mcap", tmp_path / "trial.mcap"
    write_plan(path, planned, cell, default_cell_file())
    specification = TrialSpecification(str(path), object=name, seed=5)
    prepared = prepare_trial(specification, cell)
    opened = open_log(log, specification, cell, "direct", default_cell_file(), reference=prepared.reference)
    simulated = simulated_cell(name, 0.0, 5).as_cell("direct")
    try:
        result = run_trial(prepared, simulated, RunContext(opened))
    finally:
        simulated.close()
    assert result.success, result.failure_reason
    columns = log_columns(read_log(log))
    t_s = (columns.arm[0]["t_ns"] - columns.arm[0]["t_ns"][0]) * 1e-9 - result.nominal_impact_time_s
    at_impact = (t_s > -0.01) & (t_s < 0.04)
    for arm, side in enumerate(("left", "right")):
        residual = np.abs(columns.control[arm]["momentum_residual"][at_impact]).max(axis=0)
        np.testing.assert_allclose(residual[[0, 2, 3]], predicted[side].external[[0, 2, 3]], rtol=0.2)
        torque = np.abs(columns.arm[arm]["tau_J"][at_impact]).max(axis=0)
        assert torque[5] == pytest.approx(predicted[side].torque[5], rel=0.4)  # it scatters by 14 %


@pytest.mark.long
def test_a_default_speed_that_is_too_fast_is_lowered_and_one_asked_for_is_refused(tmp_path, capsys):
    text = default_cell_file().read_text()
    cell_file, out = tmp_path / "cell.toml", tmp_path / "plan.mcap"
    cell_file.write_text(text.replace("mass = 2.20", "mass = 3.20"))
    asked = ["plan", str(out), "--object", "box_220", "--cell-file", str(cell_file)]
    with pytest.raises(
        TooFast, match=r"torque of joint 6 .*; all else as it is, the fastest speed that would do is 0.\d\d m/s"
    ):
        app([*asked, "--speed", "0.35"], standalone_mode=False)
    assert not out.exists()
    app(asked, standalone_mode=False)
    printed = capsys.readouterr().out
    assert "slower than by default: left arm: the impact takes the torque of joint 6 to" in printed
    assert out.exists()
