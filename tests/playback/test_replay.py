"""Logs of the loop, replayed through the present controller: the same bits, or the first that differs."""

import os
from dataclasses import replace

import numpy as np
import pytest

from rtstack.cells import default_cell_file, open_cell
from rtstack.control.parameters import ControlParameters
from rtstack.log.reader import read_log
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET
from rtstack.playback import replay as module
from rtstack.playback.replay import replay
from rtstack.samples import Mode
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import Followed
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification, TrialSpecification
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.trial import prepare_trial, run_trial


class StopAt:
    """A stop after so many ticks; as a watchdog it counts them."""

    def __init__(self, tick):
        self.tick = tick

    def trip(self):
        self.tick -= 1

    @property
    def stop_requested(self):
        return self.tick < 0


@pytest.fixture
def stopped_trial(cell, demonstration, tmp_path):
    """Run a trial that an operator stops after 0.4 s; return its log."""

    def run(controller="proposed", cell_kind="direct"):
        path = tmp_path / f"{controller}.mcap"
        asked = TrialSpecification(str(demonstration.path), controller, seed=3)
        prepared = prepare_trial(asked, cell)
        opened = open_cell(cell_kind, asked.object, 0.0, asked.seed)
        stop = StopAt(400)
        try:
            log = open_log(path, asked, cell, "direct", default_cell_file(), reference=prepared.reference,
                           followed=Followed(demonstration.path))  # fmt: skip
            run_trial(prepared, opened, RunContext(log, stop=stop, watchdogs=(stop,)))
        finally:
            opened.close()
        return path

    return run


@pytest.mark.parametrize("controller", ["proposed", "no_velocity_feedback"])
def test_a_trial_that_was_stopped_replays_bit_by_bit(stopped_trial, controller):
    path = stopped_trial(controller)
    control = read_log(path).topic("/left/control")
    assert int(np.flatnonzero(control["mode"] == Mode.STOPPING)[0]) == 400
    found = replay(path)
    assert found.same
    assert found.ticks == len(control)


def test_a_demonstration_replays_bit_by_bit(demonstration):
    found = replay(demonstration.path)
    assert found.same
    assert found.kind == "demonstration"


def test_another_law_is_named_by_its_first_tick_field_and_value(stopped_trial, monkeypatch, command_line):
    path = stopped_trial()
    same = command_line("replay", path)
    assert same.returncode == 0, same.stderr
    assert "every bit" in same.stdout
    real = module._description

    def stiffer(log, folder):
        described = real(log, folder)
        return replace(described, gains=replace(described.gains, posture_gain=ControlParameters().posture_gain + 1.0))

    monkeypatch.setattr(module, "_description", stiffer)
    found = replay(path)
    assert not found.same
    first = found.differences[0]
    assert first.logged != first.replayed
    logged = read_log(path).topic(f"/{first.side}/control")
    assert first.first_tick < 50
    assert first.field.partition("[")[0] in (*logged.dtype.names, *module.OURS)
    other = command_line("replay", path)
    assert other.returncode == 1
    assert f"{first.side} {first.field} is the first to differ, in tick {first.first_tick}" in other.stdout


def test_arms_led_by_hand_replay_to_the_rounding_of_their_logged_setpoints(cell, tmp_path):
    mailbox = Mailbox.create(f"rtstack-test-replay-{os.getpid()}")
    path, stop = tmp_path / "hand.mcap", StopAt(300)
    specification = TeleoperationSpecification("anna", job=1)
    opened = open_cell("direct", "rice_box", 0.0, 0)
    try:
        log = open_log(path, specification, cell, "direct", default_cell_file())
        target = np.zeros(1, TARGET)
        mailbox.write_target(target)
        run_teleoperation(specification, cell, opened, mailbox, RunContext(log, stop=stop, watchdogs=(stop,)))
    finally:
        opened.close()
        mailbox.close()
    found = replay(path)
    assert found.ticks == found.replayed_ticks
    assert max((each.largest for each in found.differences), default=0.0) < 1e-9


def test_a_log_of_something_else_is_refused(tmp_path, cell):
    from rtstack.trials.specification import SweepSpecification

    path = tmp_path / "sweep.mcap"
    open_log(path, SweepSpecification("rice_box", 1, 0), cell, "direct", default_cell_file()).close({})
    with pytest.raises(TrialError, match="its kind is identification"):
        replay(path)
