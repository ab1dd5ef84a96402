"""A hand at the mailbox moves real arms (the plant in this process), in the robot's own time: every figure is exact."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rtstack.cells import default_cell_file, open_cell
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox, Release
from rtstack.safety.limits import control_limits
from rtstack.samples import Mode, QpStatus
from rtstack.teleoperation.reach import FASTEST_M_S, HARDEST_N_M
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification, TrialSpecification
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.tightening import limits_of_arms
from rtstack.trials.trial import prepare_trial
from tests.support.hand import BEAT_MS, JOB, START, Hand
from tests.support.runs import attempt

DEAD_MAN_MS = 350


@pytest.fixture
def teleoperate(cell, tmp_path):
    """Run a teleoperation by a script; return its result, its log's control samples of both arms, and the log."""
    mailbox = Mailbox.create(f"rtstack-test-hand-{os.getpid()}")

    def run(script, safety=None, **options):
        described = replace(cell, safety={**cell.safety, **(safety or {})})
        hand = Hand(mailbox, script, cell)
        path = Path(tmp_path) / "teleoperation.mcap"
        specification = TeleoperationSpecification("anna", job=JOB, **options)
        opened = open_cell("direct", "rice_box", 0.0, 0)
        log = open_log(path, specification, cell, "direct", default_cell_file(), overwrite=True)
        try:
            context = RunContext(log, watchdogs=(hand,))
            result = run_teleoperation(specification, described, opened, mailbox, context, clock=hand.clock)
        finally:
            opened.close()
        log = read_log(path)
        return result, [log.topic(f"/{side}/control") for side in ("left", "right")], log

    yield run
    mailbox.close()


def moved(controls, side):
    """How far the command has gone, m, by tick."""
    return controls[side]["pose_ref"][:, :3] - controls[side]["pose_ref"][0, :3]


def test_the_log_has_what_was_asked_on_which_picture_and_when(teleoperate):
    def script(ms, hand):
        ago = {"made_ns": 12, "came_ns": 10, "picture_ns": 90, "seen_ns": 60}
        times = {name: hand.clock() - ms_ago * 1_000_000 for name, ms_ago in ago.items()}
        sequence = 10 + ms // BEAT_MS
        hand.hold(((0.0, 0.0, 0.05),) * 2, sequence=sequence, picture=7, dropped=(1, 2, 3, 4), **times)
        if ms == 500:
            hand.finish()

    _, _, log = teleoperate(script, recorded=True)
    hand = log.topic("/hand")
    np.testing.assert_array_equal(hand["sequence"], 10 + np.arange(len(hand)))
    assert len(hand) == 500 // BEAT_MS  # the last one came with the end
    assert (np.diff(hand["t_ns"]) == BEAT_MS * 1_000_000).all()
    np.testing.assert_allclose(hand["asked_left"][:, :3], np.tile(START[0] + (0.0, 0.0, 0.05), (len(hand), 1)))
    # the source's watchdog asks before this one: a command is applied a tick after it was written
    ages = [hand[name][1:] - hand["came_us"][1:] for name in ("made_us", "picture_us", "seen_us")]
    np.testing.assert_allclose(ages, np.repeat([[2e3], [80e3], [50e3]], len(hand) - 1, axis=1))
    assert set(hand["picture"]) == {7}
    dropped = [hand[f"dropped_{why}"][-1] for why in ("old", "order", "picture", "other")]
    assert dropped == [1, 2, 3, 4]


def first_stop_ms(log):
    """Tick of the first torque of the stop."""
    samples = log.topic("/left/control")
    stopping = np.flatnonzero(samples["mode"] == Mode.STOPPING)
    return int(samples["t_ns"][stopping[0]] - samples["t_ns"][0]) // 1_000_000


def test_a_held_clutch_moves_both_arms_to_what_is_asked_and_all_of_it_is_logged(teleoperate):
    def script(ms, hand):
        hand.hold(((0.02, -0.05, 0.1), (-0.02, 0.03, 0.05)))
        if ms == 1500:
            hand.finish()

    result, controls, log = teleoperate(script, recorded=True)
    assert (result.success, result.failure_reason) == (True, None)
    assert result.recorded
    assert log.metadata["trial"]["kind"] == "recording"
    np.testing.assert_allclose(moved(controls, 0)[1400], (0.02, -0.05, 0.1), atol=1e-3)
    np.testing.assert_allclose(moved(controls, 1)[1400], (-0.02, 0.03, 0.05), atol=1e-3)
    measured = log.topic("/left/arm")["O_T_EE"][[0, 1400], :3, 3]
    np.testing.assert_allclose(measured[1] - measured[0], (0.02, -0.05, 0.1), atol=0.01)
    assert set(controls[0]["mode"]) == {Mode.TELEOPERATION, Mode.STOPPING}
    speed = np.linalg.norm(controls[0]["twist_ref"][:, :3], axis=1)
    assert 0.1 < speed.max() <= 0.3 + 1e-9


def test_nothing_moves_before_the_clutch_is_held_nor_by_targets_of_another_job(teleoperate):
    def script(ms, hand):
        if ms < 300:
            hand.hold(((0, 0, 0.1), (0, 0, 0.1)), job=JOB - 1)
        elif ms == 300:
            hand.finish()  # of the other job
        elif ms == 600:
            hand._target["job"] = JOB
            hand.finish()

    result, controls, _ = teleoperate(script)
    assert not result.moved
    assert np.abs(moved(controls, 0)).max() < 1e-9
    assert len(controls[0]) > 600


@pytest.mark.parametrize(
    ("cause", "end"), [("released", End.RELEASED), ("hidden", End.RELEASED), ("silence", End.CLUTCH_QUIET)]
)
def test_a_clutch_that_is_let_go_or_goes_quiet_stops_the_arms_in_time(teleoperate, cause, end):
    cause_ms = 601  # just after a beat: the worst moment to go quiet

    def script(ms, hand):
        if ms < cause_ms:
            hand.hold(((0, 0, 0.2), (0, 0, 0.2)))
        elif ms == cause_ms and cause != "silence":
            hand.release(Release.RELEASED if cause == "released" else Release.LOST)

    result, controls, log = teleoperate(script, recorded=True)
    assert 0 <= first_stop_ms(log) - cause_ms <= (DEAD_MAN_MS if cause == "silence" else 3)
    assert np.linalg.norm(controls[0]["twist_ref"][cause_ms][:3]) > 0.2  # it was in full motion
    assert result.success == (cause == "released")
    said = [event.text for event in log.events]
    assert any(text.startswith(str(end)) for text in said), said
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.02


def test_who_chose_to_hold_brakes_on_release_and_goes_on_with_the_clutch(teleoperate):
    def script(ms, hand):
        if ms < 800 or ms >= 2500:
            hand.hold(((0, 0, 0.1), (0, 0, 0.1)), speed=0.05)
        elif ms == 801:
            hand.release()
        if ms == 4500:
            hand.finish()

    result, controls, _ = teleoperate(script, stop_on_release=False)
    assert result.success
    way = moved(controls, 0)[:, 2]
    assert way[800] < 0.05
    assert np.ptp(way[1000:2500]) < 1e-9  # it holds, for as long as it takes: nobody has to beat
    assert way[-1] == pytest.approx(0.1, abs=2e-3)


def test_who_chose_to_hold_is_stopped_all_the_same_when_the_page_is_hidden(teleoperate):
    def script(ms, hand):
        if ms < 500:
            hand.hold()
        elif ms == 500:
            hand.release(Release.LOST)

    result, _, log = teleoperate(script, stop_on_release=False)
    assert result.duration_s < 1.0
    assert first_stop_ms(log) <= 503


@pytest.mark.parametrize(
    "bad", [np.full((2, 7), np.nan), np.full((2, 7), np.inf), np.zeros((2, 7)), np.full((2, 7), 1e300)]
)
def test_requests_that_are_no_poses_or_jumps_move_nothing(teleoperate, bad):
    def script(ms, hand):
        hand.hold(pose=bad, speed=np.nan, stiffness=np.inf)
        if ms == 300:
            hand.finish()

    result, controls, _ = teleoperate(script)
    assert result.success
    for side in (0, 1):
        assert np.isfinite(controls[side]["pose_ref"]).all()
        assert np.abs(moved(controls, side)).max() < 1e-9


def test_a_jump_is_not_followed_and_the_edge_of_the_box_is_kept(teleoperate, cell):
    def script(ms, hand):
        if ms < 500:
            hand.hold(((0, 0, 0.4), (0, 0, 0)))  # further ahead than a hand
        else:
            hand.hold(((0.24, 0.04, -0.04), (0, 0, 0)), speed=9.0)
        if ms == 2500:
            hand.finish()

    result, controls, _ = teleoperate(script)
    assert result.success, result.failure_reason
    assert np.abs(moved(controls, 0)[:500]).max() < 1e-9
    at = controls[0]["pose_ref"][2400, :3]
    lower, upper = cell.safety["ee_lower"], cell.safety["ee_upper"]
    np.testing.assert_allclose(at, (upper[0] - 0.03, upper[1] - 0.03, lower[2] + 0.01), atol=1e-3)
    assert np.linalg.norm(controls[0]["twist_ref"][:, :3], axis=1).max() <= FASTEST_M_S + 1e-9


def test_stiffness_stays_within_its_bounds_and_never_jumps(teleoperate):
    def script(ms, hand):
        hand.hold(((0, 0, 0), (0, 0, 0)) if ms < 500 else ((0, -0.2, 0.05), (0, 0.2, 0.05)), stiffness=5000.0)
        if ms == 3000:
            hand.finish()

    result, controls, log = teleoperate(script)
    assert result.success, result.failure_reason
    base_y = 0.5  # the left arm's, along the world's y: what the robot says is in its base's frame
    error = controls[0]["pose_ref"][2900, 1] - log.topic("/left/arm")["O_T_EE"][2900, 1, 3] - base_y
    assert -controls[0]["wrench_desired"][2900, 1] == pytest.approx(HARDEST_N_M * abs(error), rel=0.15)
    assert np.abs(np.diff(log.topic("/left/arm")["tau_desired"][600:3000], axis=0)).max() < 1.0


@pytest.mark.parametrize(("name", "value"), [("dq_max", 0.15), ("q_upper", -2.3)])
def test_a_hand_that_asks_for_more_than_a_joint_may_rides_along_its_limit(teleoperate, cell, name, value):
    """Joint 4 stretches at its fastest, or to its end, for a second, and the judge has no part in it."""
    limits = limits_of_arms(cell)[0]
    values = list(getattr(limits, name))
    values[3] = value

    def script(ms, hand):
        hand.hold(((0.17, 0, 0), (0.17, 0, 0)), speed=0.4)
        if ms == 4000:
            hand.finish()

    result, controls, log = teleoperate(script, safety={name: values})
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    for side, control in zip(("left", "right"), controls, strict=True):
        sample = log.topic(f"/{side}/arm")
        here = {"dq_max": sample["dq"], "q_upper": sample["q"]}[name][:, 3]
        assert here.max() < value
        line = control_limits(limits.tightened({name: values}))[0]
        rest = line["dq_max"][3] if name == "dq_max" else value - line["velocity_offset"][3] ** 2 / 8.0
        near = (control["qp_status"] == QpStatus.SOLVED) & (np.abs(here - rest) < 0.01)
        assert np.diff(np.flatnonzero(~near)).max() > 1000, (side, here.max(), rest)


def test_a_grab_by_hand_is_a_reference_that_a_trial_follows(teleoperate, cell):
    def script(ms, hand):
        close, lift = np.clip((ms - 1500) / 1000, 0.0, 1.0), np.clip((ms - 2700) / 800, 0.0, 1.0)
        away = np.clip((ms - 4700) / 800, 0.0, 1.0)
        inward = 0.31 * close - 0.2 * away
        rise = 0.1 * np.clip((ms - 1300) / 900, 0.0, 1.0) + 0.1 * (lift - np.clip((ms - 3900) / 800, 0.0, 1.0))
        hand.hold(((0, -inward, rise), (0, inward, rise)), speed=0.4)
        if ms == 6000:
            hand.release()

    result, _, log = teleoperate(script, recorded=True)
    assert result.success, result.failure_reason
    assert result.detected_impact_time_s is not None
    prepared = prepare_trial(TrialSpecification(str(log.path), object="rice_box"), cell)
    reference = prepared.reference
    # it begins a moment before the first motion, not with the waiting
    assert reference.nominal_impact_s < result.detected_impact_time_s - 0.8
    assert np.abs(reference.ante[0]["twist"][:200]).max() < 0.01
    trial = attempt(prepared, cell)
    assert trial.detected_impact_time_s == pytest.approx(reference.nominal_impact_s, abs=0.03)
    assert trial.max_lift_mm == pytest.approx(100.0, abs=60.0)
    assert "safety" not in (trial.failure_reason or "")
