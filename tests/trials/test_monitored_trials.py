"""The monitor in whole trials: verdicts in log, events and result, and what an unexpected one leads to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.log_folder.catalogue import Catalogue
from rtstack.log_folder.log_rows import log_row
from rtstack.model.cell_description import base_poses
from rtstack.monitor.records import Verdict
from rtstack.references.demonstration import Grab
from rtstack.samples import Level, Mode, Reaction
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import tuning_folder, tuning_of
from rtstack.trials.review import log_columns
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from rtstack.trials.tuning import GoodRun, replay
from tests.support.runs import attempt, demonstrate

PUSH = '[[fault]]\nkind = "push"\narm = "left"\nat_s = 2.0\nduration_s = 0.4\nforce_N = [40.0, 0.0, 0.0]\n'
MISSING = '[[fault]]\nkind = "object_lost"\nat_s = 0.0\n'


@pytest.fixture
def trial(cell, demonstration, tmp_path):
    """Runs a trial with this script of faults and this reaction; gives result, log and what was prepared."""

    def run(script: str = "", reaction: Reaction = Reaction.CONTINUE):
        faults = tmp_path / "faults.toml"
        faults.write_text(script)
        specification = TrialSpecification(str(demonstration.path), seed=3, displacement_mm=12.0, reaction=reaction)
        prepared = prepare_trial(specification, cell)
        path = Path(tmp_path / "trial.mcap")
        return attempt(prepared, cell, path, faults=faults), read_log(path), prepared

    return run


def said(log) -> list[str]:
    return [event.text for event in log.events if event.name == "verdict"]


def test_a_good_grab_is_expected_and_its_log_says_so_again(trial) -> None:
    result, log, prepared = trial()
    assert result.success
    assert result.impact_verdict == "expected"
    assert result.impact_reason is None
    assert result.impact_kind is None
    control = log.topic("/left/control")
    assert set(control["pair_verdict"].tolist()) == {Verdict.NONE, Verdict.EXPECTED}
    assert log.metadata["result"]["impact_verdict"] == "expected"
    (text,) = said(log)
    assert text.startswith("expected, margin 0.")
    columns = log_columns(log)
    run = GoodRun("trial", columns, prepared.reference.impact, base_poses(prepared.description))
    monitor = replay(run, tuning_of("rice_box").monitor)
    assert monitor.verdict is Verdict.EXPECTED
    assert float(monitor.pair[0]["t_verdict_ns"]) * 1e-9 == result.impact_verdict_time_s


def test_a_push_stops_the_arms_in_the_tick_of_the_verdict(trial) -> None:
    result, log, _ = trial(PUSH, Reaction.STOP)
    assert (result.impact_verdict, result.impact_kind) == ("unexpected", "another contact, such as a push")
    assert not result.success
    control = log.topic("/left/control")
    verdict = int(np.argmax(control["pair_verdict"] == Verdict.UNEXPECTED))
    assert 2000 <= verdict <= 2015
    assert control["mode"][verdict] == Mode.STOPPING
    assert control["mode"][verdict - 1] != Mode.STOPPING
    assert json.loads(log.metadata["trial"]["specification"])["reaction"] == "stop"
    assert any(event.level is Level.WARNING and event.name == "verdict" for event in log.events)


def test_a_push_is_held_against(trial) -> None:
    result, log, _ = trial(PUSH, Reaction.HOLD)
    control = log.topic("/left/control")
    verdict = int(np.argmax(control["pair_verdict"] == Verdict.UNEXPECTED))
    held = np.flatnonzero(control["mode"] == Mode.HOLDING)
    assert held[0] == verdict
    place = control["pose_ref"][held, :3]
    assert np.linalg.norm(place[-1] - place[200]) < 1e-9  # it has braked, and stays
    steps = np.linalg.norm(np.diff(control["pose_ref"][verdict - 50 : verdict + 300, :3], axis=0), axis=1)
    assert steps.max() < 1e-3  # m in a ms, and no jump at the beginning
    assert result.safety_interventions == 0


def test_where_nothing_was_met_the_arms_go_back_and_nobody_has_to_recover(trial) -> None:
    result, log, _ = trial(MISSING, Reaction.RETREAT)
    assert (result.impact_verdict, result.impact_kind) == ("unexpected", "object missing")
    assert result.failure_reason.startswith("another impact than was meant")
    assert "fault" not in log.metadata
    for side, sign in (("left", 1.0), ("right", -1.0)):
        control, arm = log.topic(f"/{side}/control"), log.topic(f"/{side}/arm")
        back = np.flatnonzero(control["mode"] == Mode.RETREATING)
        verdict = int(np.argmax(control["pair_verdict"] == Verdict.UNEXPECTED))
        assert verdict - 1 <= back[0] <= verdict + 1  # the other arm's verdict counts in the same tick
        y = arm["O_T_EE"][back, 1, 3] * sign
        assert y[-1] - y.min() > 0.08


def test_a_retreat_goes_no_further_back_than_the_arm_has_come(trial) -> None:
    result, log, _ = trial(PUSH.replace("2.0", "0.8"), Reaction.RETREAT)
    assert result.safety_interventions == 0  # the judge's box for the end effectors begins behind the start
    for side in ("left", "right"):
        control = log.topic(f"/{side}/control")
        back = control["pose_ref"][control["mode"] == Mode.RETREATING, :3]
        assert len(back) > 0
        come = np.linalg.norm(back[0] - control["pose_ref"][0, :3])
        assert np.linalg.norm(back[-1] - back[0]) < come + 0.02  # what it brakes with


def test_where_something_was_hit_in_free_air_a_person_has_to_recover(trial) -> None:
    result, log, _ = trial(PUSH.replace("2.0", "0.8"), Reaction.HOLD)
    assert (result.impact_verdict, result.impact_reason) == ("unexpected", "time")
    assert result.failure_reason.startswith("something was hit that was not meant")
    assert log.metadata["fault"]["end"] == "something was hit that was not meant"


@pytest.mark.parametrize("displacement_mm", [-48.0, 48.0])
def test_an_object_just_beyond_what_the_tuning_knows_is_in_the_wrong_place_and_no_push(runner, displacement_mm):
    """The first pad meets it within the bound of time, and beyond that of the configuration."""
    result = runner.run(displacement_mm=displacement_mm)
    assert (result.impact_verdict, result.impact_reason) == ("unexpected", "configuration")
    assert result.impact_kind == "wrong place"


def test_a_slow_hand_that_meets_a_displaced_object_half_a_second_early_is_no_push(cell, runner, tmp_path):
    path = tmp_path / "slow.mcap"
    assert demonstrate(path, cell, script=Grab(approach_s=1.8, speed_y=0.1, speed_z=0.05, steady_s=0.8)).success
    result = replace(runner, reference=path).run(displacement_mm=48.0)
    assert result.detected_impact_time_s is not None
    assert result.nominal_impact_time_s - result.detected_impact_time_s > 0.4
    assert (result.impact_verdict, result.impact_reason) == ("unexpected", "time")
    assert result.impact_kind == "too early"  # both pads meet it, since the first one pushes it to the other


def test_an_object_without_a_tuning_is_not_watched_and_its_trial_says_how_to_make_one(cell, demonstration, tmp_path):
    specification = TrialSpecification(str(demonstration.path), object="box_060")
    with pytest.raises(TrialError, match="nothing would start the reaction hold: the monitor is not tuned for box_060"):
        prepare_trial(replace(specification, reaction=Reaction.HOLD), cell)
    assert prepare_trial(specification, cell, monitor=tuning_of("rice_box").monitor).unwatched is None
    real, asked = replace(cell, simulated=False), replace(specification, reaction=Reaction.CONTINUE)
    with pytest.raises(TrialError, match="nothing watches the impact on these arms: the monitor is not tuned for"):
        prepare_trial(asked, real)
    assert prepare_trial(asked, replace(real, unexpected_impact=Reaction.CONTINUE)).unwatched is not None
    prepared = prepare_trial(specification, cell)
    result = attempt(prepared, cell, tmp_path / "trial.mcap")
    assert (result.impact_verdict, result.impact_margin, result.impact_kind) == (None, None, None)
    (event,) = [event for event in read_log(tmp_path / "trial.mcap").events if event.name == "verdict"]
    assert event.level is Level.INFO
    assert f"rtstack tune-monitor LOG.mcap... --out {tuning_folder() / 'box_060.toml'}" in event.text
    (entry,) = Catalogue(tmp_path).entries()
    assert log_row(entry, None).verdict == "not watched"  # in the console's list
