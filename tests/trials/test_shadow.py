"""A shadow: the loop computes, judges and logs on the arms' states, and no torque reaches them."""

from dataclasses import replace

import numpy as np
import pytest

from hal.cell import Cell
from hal.errors import CommandRejected
from rtstack.cells import load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.samples import Mode
from rtstack.trials.carry_out import shadow_of
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.support.runs import demonstrate


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    path = tmp_path_factory.mktemp("shadow") / "ref.mcap"
    demonstrate(path, load_description(None)[0])
    return path


def test_torques_are_computed_and_logged_and_the_arms_stay(reference, tmp_path, command_line):
    done = command_line("trial", f"--reference={reference}", "--shadow", "--log=out.mcap", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith("shadow: no torque was sent; the loop ended by: no impact was detected")
    log = read_log(tmp_path / "out.mcap")
    assert log.metadata["result"]["success"] == "false"
    assert any(event.name == "shadow" for event in log.events)
    for side in log.sides:
        arm, control = log.topic(f"/{side}/arm"), log.topic(f"/{side}/control")
        assert Mode.ANTE_IMPACT in control["mode"]
        assert np.abs(arm["q"] - arm["q"][0]).max() < 1e-3  # held by its own robot
        assert np.abs(arm["tau_applied"]).max() > 5.0  # the reference goes away from where the arm is held
        assert np.abs(np.diff(arm["tau_applied"], axis=0)).max() <= 1.0 + 1e-9  # judged: the torque's rate


class Forbidden:
    """An arm and a link that refuse every command."""

    def __init__(self, thing) -> None:
        self.read = getattr(thing, "read", None)
        self.wait, self.close = getattr(thing, "wait", None), thing.close

    def __getattr__(self, name: str):
        raise CommandRejected(f"{name} reached the arm")


def test_nothing_that_commands_reaches_an_arm():
    cell = open_cell("direct", "rice_box", 0.0, 0)
    inner: Cell = replace(cell, left=Forbidden(cell.left), right=Forbidden(cell.right), link=Forbidden(cell))  # type: ignore[arg-type]
    shadow = shadow_of(replace(inner, own_clocks=True))
    shadow.set_collisions()
    shadow.start()
    for arm in shadow.arms:
        arm.read()
        arm.write(np.full(7, 3.0))
        assert np.all(arm.read().record["tau_J_d"] == 3.0)
    shadow.recover()
    shadow.stop()
    assert np.all(shadow.arms[0].read().record["tau_J_d"] == 0.0)
    cell.close()


def test_arms_that_wait_for_answers_have_no_shadow(reference):
    cell = open_cell("direct", "rice_box", 0.0, 0)
    with pytest.raises(TrialError, match="do not wait for answers"):
        shadow_of(replace(cell, link=Forbidden(cell)))  # type: ignore[arg-type]
    cell.close()


def test_a_cell_that_refuses_trials_lets_a_shadow_pass(reference):
    description = replace(load_description(None)[0], refused={"trial": "not yet"}, simulated=False)
    specification = TrialSpecification(reference=str(reference), object="rice_box", shadow=True)
    prepared = prepare_trial(specification, description)
    assert prepared.refusal == ""
    assert prepared.specification.title.endswith(", shadow")
