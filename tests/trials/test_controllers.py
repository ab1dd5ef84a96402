"""Controllers by name: ours, and one of another package, which runs through the same judge, monitor, log and result."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.samples import Mode, QpStatus
from rtstack.trials.controllers import DEFAULT, controller_names
from rtstack.trials.errors import TrialError
from rtstack.trials.review import log_columns
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial

Install = Callable[..., None]
GROUP = "rtstack.controllers"
PAPERS = ("no_interim", "no_reference_spreading", "no_velocity_feedback", "proposed")

# holds the joints where they are; {spoil} is done in tick 100
HOLDING = """
import numpy as np
from rtstack.control.modes import Strategy
from rtstack.samples import QpStatus

class Holding:
    def __init__(self, arm):
        self.arm, self.ticks, self.held = arm, 0, None
        self.points = None

    def follow(self, ante, post):
        self.points = len(ante)

    def observe(self):
        if self.held is None:
            self.held = self.arm.sample["q"][0].copy()

    def command(self, mode):
        self.ticks += 1
        sample, work = self.arm.sample[0], self.arm.workspace[0]
        tau = 300.0 * (self.held - sample["q"]) - 30.0 * sample["dq"] + work["coriolis"] + work["friction"]
        sample["tau_desired"][:] = np.clip(tau, work["tau_previous"] - self.arm.limits["tau_step"],
                                           work["tau_previous"] + self.arm.limits["tau_step"])
        self.arm.control["wrench_desired"][0, 2] = 7.0
        if self.ticks == 100:
            {spoil}
        return QpStatus.NOT_USED

def hold(request):
    assert request.nominal_impact_s >= 0.0
    modes = request.modes(Strategy.NO_REFERENCE_SPREADING)
    return request.pair(modes, tuple(Holding(arm) for arm in request.arms))
"""


def test_the_papers_controllers_come_through_the_same_door() -> None:
    assert set(PAPERS) < set(controller_names())
    assert controller_names()[0] == DEFAULT


def test_a_controller_of_another_package_runs_a_trial(install: Install, runner, tmp_path: Path) -> None:
    install("holding", HOLDING.format(spoil="pass"), GROUP, hold="hold")
    log = tmp_path / "trial.mcap"
    result = runner.run("hold", log=log)
    assert result.controller == "hold"
    assert result.safety_interventions == 0
    assert result.failure_reason == "the object was not held until release"
    read = read_log(log)
    assert json.loads(read.metadata["trial"]["specification"])["controller"] == "hold"
    assert json.loads(read.metadata["trial"]["versions"])["holding"] == "1.2"
    columns = log_columns(read)
    moving = columns.control["mode"] != Mode.STOPPING
    assert set(np.unique(columns.control["qp_status"])) == {QpStatus.NOT_USED}
    assert (columns.control["wrench_desired"][:, :, 2][moving] == 7.0).all()
    assert (np.abs(columns.control["pose_ref"][:, 10, :3]) > 0.0).any(axis=1).all()
    assert np.abs(columns.control["momentum_residual"]).max() > 0.0
    assert np.abs(columns.arm["q"] - columns.arm["q"][:, :1]).max() < 0.05


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        ("raise RuntimeError('a defect')", "an exception in the control loop: RuntimeError: a defect"),
        ("return QpStatus.INFEASIBLE", "the QP was not solved: infeasible"),
        ("sample['tau_desired'][3] = np.nan", "safety stop: left: "),
    ],
)
def test_what_goes_wrong_in_it_stops_the_arms(install: Install, runner, spoil: str, reason: str) -> None:
    install("holding", HOLDING.format(spoil=spoil), GROUP, hold="hold")
    result = runner.run("hold")
    assert not result.success
    assert reason in str(result.failure_reason)
    assert result.ticks < 400


def test_what_cannot_be_loaded_is_refused_before_a_cell_is_opened(install: Install, runner) -> None:
    install("broken", "import no_such_module", GROUP, broken="hold")
    with pytest.raises(TrialError, match=r"controller 'broken': broken:hold of broken 1\.2 cannot be loaded"):
        prepare_trial(TrialSpecification(str(runner.reference), "broken"), runner.cell)
    assert prepare_trial(TrialSpecification(str(runner.reference)), runner.cell)


def test_an_unknown_name_is_refused_with_all_that_there_are(command_line, install: Install) -> None:
    install("holding", HOLDING.format(spoil="pass"), GROUP, hold="hold")
    said = command_line("trial", "--reference", "x.mcap", "--controller", "nothing")
    assert said.returncode == 2
    assert "unknown controller 'nothing': choose one of contact_completion, hold, no_interim" in said.stderr
