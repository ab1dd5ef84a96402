"""Trials with the judge wired in: nothing in a good one, and what a limit in reach makes of it."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hal.limits import COLLISION_TORQUES
from rtstack.log.reader import read_log
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.trials.assembly import default_parameters
from rtstack.trials.review import log_columns
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.support.runs import attempt
from tests.support.sampling import sampled


@pytest.mark.parametrize(
    ("controller", "displacement_mm"), list(zip(Controller, (-30.0, 30.0, 0.0, -30.0, 30.0), strict=True))
)
def test_the_judge_changes_nothing_in_a_good_trial(runner, controller, displacement_mm):
    result = runner.run(controller, displacement_mm)
    assert result.success, result.failure_reason
    assert result.safety_interventions == 0


# a limit within a trial's reach, and what is said
IN_REACH: dict[str, tuple[Any, str]] = {
    "ee_upper": ([0.2, 0.4, 0.4], r"(left|right): the end effector has left its box \(0\.400\d* m, allowed 0\.4\)"),
    "ee_lower": ([-0.2, -0.3, 0.25], r"right: the end effector has left its box \(-0\.3\d* m, allowed -0\.3\)"),
    "ee_speed_max": (0.3, r"(left|right): the end effector is too fast \(0\.3\d* m/s, allowed 0\.3\)"),
    "power_max": (10.0, r"(left|right): the mechanical power is too large \(-?1\d(\.\d+)? W, allowed 10\)"),
    "arm_distance_min": (0.4, r"(left|right): the arms are too close to each other \(0\.39\d* m, allowed 0\.4\)"),
    "tau_ext_max": ([8.0] * 7, r"(left|right): joint \d: the (momentum residual|estimated external torque) is too"),
}


@pytest.mark.parametrize("limit", sampled(IN_REACH, ("ee_upper", "tau_ext_max").__contains__))
def test_a_limit_in_reach_stops_every_trial_and_says_which(runner, tmp_path, limit):
    value, said = IN_REACH[limit]
    tightened = replace(runner, cell=replace(runner.cell, safety={limit: value}))
    for controller in (Controller.PROPOSED, Controller.NO_REFERENCE_SPREADING):
        path = tmp_path / f"{controller}.mcap"
        result = tightened.run(controller, log=path)
        assert not result.success
        assert result.safety_interventions >= 1
        reason = str(result.failure_reason)
        assert re.match(f"safety stop: {said}", reason), reason
        log = read_log(path)
        assert reason.encode() in log.topic("/events")["text"].tolist()
        assert np.abs(log_columns(log).arm["dq"][:, -1]).max() < 0.02


def test_the_controllers_residual_is_judged_too(runner, tmp_path):
    """With a nervous observer, which nothing else listens to, it leaves limits that the robot's estimate keeps."""
    path = tmp_path / "good.mcap"
    assert runner.run(log=path).success
    highest = np.abs(log_columns(read_log(path)).arm["tau_ext_hat_filtered"]).max(axis=(0, 1))
    cell = replace(runner.cell, safety={"tau_ext_max": np.minimum(1.01 * highest, COLLISION_TORQUES).tolist()})
    parameters = default_parameters()
    nervous = replace(parameters, inertia=replace(parameters.inertia, observer_gain_hz=1500.0))
    prepared = prepare_trial(TrialSpecification(str(runner.reference), seed=1), cell, nervous)
    result = attempt(prepared, cell)
    assert "the momentum residual is too large" in str(result.failure_reason)
