"""Logs of the loop, replayed through the present controller: the same bits, or the first that differs."""

import json
import os
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import read_toml, toml_text
from rtstack.cells import default_cell_file, open_cell
from rtstack.cli.replay import forces
from rtstack.control.parameters import ControlParameters
from rtstack.log.reader import read_log
from rtstack.loop.mailbox import TARGET, Mailbox
from rtstack.playback import replay as module
from rtstack.playback.replay import replay, replay_in_twin
from rtstack.samples import Mode
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import Followed
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification, TrialSpecification
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.recorded_run import FOLDER, KINDS, RENEW, replayed
from tests.support.runs import StopAfter


@pytest.fixture
def stopped_trial(cell, demonstration, tmp_path):
    """Run a trial that an operator stops after 0.4 s; return its log."""

    def run(controller="proposed", cell_kind="direct"):
        path = tmp_path / f"{controller}.mcap"
        asked = TrialSpecification(str(demonstration.path), controller, seed=3)
        prepared = prepare_trial(asked, cell)
        opened = open_cell(cell_kind, asked.object, 0.0, asked.seed)
        try:
            log = open_log(path, asked, cell, "direct", default_cell_file(), reference=prepared.reference,
                           followed=Followed(demonstration.path))  # fmt: skip
            run_trial(prepared, opened, RunContext(log, stop=StopAfter(400)))
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
    path = tmp_path / "hand.mcap"
    specification = TeleoperationSpecification("anna", job=1)
    opened = open_cell("direct", "rice_box", 0.0, 0)
    try:
        log = open_log(path, specification, cell, "direct", default_cell_file())
        target = np.zeros(1, TARGET)
        mailbox.write_target(target)
        run_teleoperation(specification, cell, opened, mailbox, RunContext(log, stop=StopAfter(300)))
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


PROFILES = Path(str(files("sim_robot"))) / "parameters/profiles"


def test_a_twin_that_is_the_robot_gives_the_logs_contact_force(demonstration):
    made = replay_in_twin(demonstration.path, "ideal")
    assert abs(made.replayed_ticks - made.ticks) < 50  # a script waits for its impact
    for arm in made.arms:
        assert arm.ticks > 1000
        assert abs(arm.off) < 0.05
        assert arm.path_mm < 5.0
    told = "\n".join(forces(made))
    assert f"{made.arms[0].mean_n[0]:.1f} N" in told


def test_another_robot_is_seen_in_force_or_path(demonstration, tmp_path, command_line):
    profile = tmp_path / "other.toml"
    document, _ = read_toml(PROFILES / "ideal.toml")
    profile.write_text(toml_text(document | {"left": {"friction_p1": [3.0] * 7, "payload_kg": 1.5}}))
    said = command_line("replay", demonstration.path, "--twin", profile, "--json")
    assert said.returncode in (0, 1), said.stderr
    left, right = json.loads(said.stdout)["arms"]
    assert left["path_mm"] > 2.0 * right["path_mm"]
    assert np.linalg.norm(left["torque_nm"]) > 2.0 * np.linalg.norm(right["torque_nm"])


def test_an_unknown_profile_is_one_line(demonstration):
    with pytest.raises(TrialError, match="unknown profile 'mine'"):
        replay_in_twin(demonstration.path, "mine")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_controller_and_judge_make_the_same_of_recorded_states(kind, cell, demonstration):
    differs = replayed(kind, FOLDER / f"{kind.name}.npz", demonstration.path, cell)
    assert differs is None, f"{differs}; where the law was to change, record the runs anew: {RENEW}"


def test_another_law_is_found(cell, demonstration):
    from dataclasses import replace

    kind = KINDS[0]
    harder = replace(cell, gains=replace(cell.gains, posture_gain=501.0))
    differs = replayed(kind, FOLDER / f"{kind.name}.npz", demonstration.path, harder)
    assert differs is not None
    assert re.fullmatch(r"tick \d+: (left|right) \w+(\[\d\])?: \S+ recorded, \S+ now", differs)
