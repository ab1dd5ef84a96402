"""A demonstration played on the arms (the plant in this process), in the robot's own time: every figure is exact."""

import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from rtstack.cells import default_cell_file, open_cell
from rtstack.cli.trials import play
from rtstack.log.reader import read_log
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.loop.mailbox import TARGET, Mailbox
from rtstack.playback.path import RAMP_S
from rtstack.playback.run import prepare_playback
from rtstack.playback.source import Finish
from rtstack.samples import Mode
from rtstack.topics import TOPICS
from rtstack.trials.errors import TrialError
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import PlaybackSpecification

JOB = 7


class Script:
    """A watchdog that never trips: `act(ms)` is called each tick."""

    def __init__(self, act):
        self._act = act
        self._ms = -1

    def trip(self):
        self._ms += 1
        self._act(self._ms)


class Stop:
    """STOP, when it is pressed."""

    stop_requested = False

    def press(self):
        self.stop_requested = True


@pytest.fixture(scope="module")
def prepared(cell, demonstration):
    """The shared demonstration at its own speed."""
    return prepare_playback(PlaybackSpecification(str(demonstration.path)), cell)


@pytest.fixture
def played(cell, prepared, tmp_path):
    """Play the shared demonstration; return result and log."""

    def run(speed=1.0, thing="", act=lambda ms: None, **around):
        path = tmp_path / "played.mcap"
        slowed = replace(prepared, specification=replace(prepared.specification, speed=speed))
        opened = open_cell("direct", thing, 0.0, 0, cell)
        try:
            assert slowed.start_motion(opened) is None
            log = open_log(path, slowed.specification, cell, "direct", default_cell_file(), overwrite=True)
            context = RunContext(log, watchdogs=(Script(act),), **around)
            result = slowed.run(opened, context)
        finally:
            opened.close()
        return result, read_log(path)

    return run


def moving(log, side="left"):
    """Control samples before the stop."""
    control = log.topic(f"/{side}/control")
    return control[control["mode"] == Mode.TELEOPERATION]


def test_a_grab_is_played_without_its_object_softly_begun_and_ended(played, demonstration):
    shares = []
    result, log = played(progress=shares.append)
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    assert result.played_s == pytest.approx(result.duration_s)
    assert result.largest_error_mm < 3.0  # 6 N of the spring
    assert log.metadata["trial"]["kind"] == "playback"
    assert json.loads(log.metadata["trial"]["specification"])["source"] == str(demonstration.path)
    assert shares == sorted(shares)
    assert shares[-1] > 0.95
    for side in ("left", "right"):
        reference = moving(log, side)
        assert len(reference) == pytest.approx(1e3 * (result.duration_s + RAMP_S), abs=3)
        speed = np.linalg.norm(reference["twist_ref"][:, :3], axis=1)
        assert speed[0] == 0.0
        assert speed[-1] < 1e-3
        assert speed.max() > 0.2
        # where the pads went in the demonstration, they go now
        once, again = read_log(demonstration.path).topic(f"/{side}/arm")["O_T_EE"], log.topic(f"/{side}/arm")["O_T_EE"]
        apart = np.linalg.norm(once[::50, None, :3, 3] - again[None, ::10, :3, 3], axis=2).min(axis=1)
        assert apart.max() < 0.015  # it is the curve that is played: an impact's shaking is smoothed away


def test_a_soft_stop_brakes_along_the_path_and_tells_how_far_it_came(played):
    mailbox = Mailbox.create(f"rtstack-test-play-{os.getpid()}")
    try:
        target = np.zeros(1, TARGET)

        def act(ms):
            if ms in (600, 900):  # the first one is of another job
                target["job"], target["finish"] = JOB - (ms == 600), 1
                mailbox.write_target(target)

        result, log = played(act=act, soft_stop=Finish(mailbox, JOB), stop=Stop())
    finally:
        mailbox.close()
    assert not result.success
    assert result.failure_reason == "stop requested by the operator"
    assert result.safety_interventions == 0
    reference = moving(log)
    assert len(reference) == pytest.approx(900 + 1e3 * RAMP_S, abs=4)
    assert result.played_s == pytest.approx(0.9, abs=0.01)  # each ramp takes half of its time from the log's
    speed = np.linalg.norm(reference["twist_ref"][:, :3], axis=1)
    assert speed[-1] < 1e-3
    assert speed[900:].max() > 0.05
    assert np.abs(np.diff(reference["twist_ref"][900:, :3], axis=0)).max() < 0.01  # 10 m/s^2


def test_stop_is_the_judges_and_quicker(played):
    stop = Stop()
    result, log = played(act=lambda ms: ms == 900 and stop.press(), stop=stop)
    assert result.failure_reason == "stop requested by the operator"
    assert len(moving(log)) == pytest.approx(900, abs=2)
    assert result.played_s == pytest.approx(0.9 - RAMP_S / 2, abs=0.01)


def test_what_is_met_stops_both_arms_even_slowly(played, demonstration):
    result, log = played(0.5, thing="rice_box")
    assert not result.success
    assert re.match(r"something was hit that was not meant: the (left|right) pad (was hit|felt)", result.failure_reason)
    assert result.played_s == pytest.approx(demonstration.result.detected_impact_time_s, abs=0.05)
    assert max(np.abs(log.topic(f"/{side}/arm")["dq"][-1]).max() for side in ("left", "right")) < 0.05


def rewritten(source, target, change):
    """Write a log again with its arms' samples changed."""
    log = read_log(source)
    columns = {topic: log.topic(topic) for topic in TOPICS}
    for side in ("left", "right"):
        columns[f"/{side}/arm"] = change(columns[f"/{side}/arm"])
    with open(target, "wb") as file:
        writer = McapWriter(file)
        writer.write_metadata("trial", log.metadata["trial"])
        writer.write(columns, {})
        writer.close()
    return target


def elsewhere(samples):
    samples["q"][:, 4] += 0.05
    return samples


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda samples: samples[:100], "its motion lasts 0.1 s"),
        (lambda samples: samples[np.abs(np.arange(len(samples)) - 2000) > 15], "32 ms of the motion are missing"),
        (lambda samples: samples[:0], "nothing to play|no log"),
        (elsewhere, "begins 0.05 rad from where joint 5 of the left arm is"),
    ],
)
def test_what_cannot_be_played_is_refused_with_the_reason_and_nothing_written(demonstration, tmp_path, change, reason):
    source = rewritten(demonstration.path, tmp_path / "changed.mcap", change)
    with pytest.raises(TrialError, match=reason) as refused:
        play(source=source, log=tmp_path / "out.mcap")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out.mcap").exists()


def test_a_speed_beyond_the_limits_is_refused_with_the_limit(demonstration, tmp_path):
    with pytest.raises(TrialError, match=r"joint \d would .* is allowed at speed 3: play it more slowly"):
        play(source=demonstration.path, speed=3.0, log=tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()
