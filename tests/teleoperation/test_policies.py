"""A policy at the mailbox moves real arms (the plant in this process), in the robot's own time: figures are exact."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from learned_grab.demonstrations import run_watched
from learned_grab.scripted import scripted_way

from hal.displacement import Displacement
from rtstack.cells import default_cell_file, open_cell
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.loop.mailbox import TARGET, Mailbox
from rtstack.model.arm_model import ArmModel
from rtstack.samples import Level, Mode
from rtstack.teleoperation.policy import Chunk, pad_pose
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext, RunEvent
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.teleoperation import PolicyHost, run_policy, run_teleoperation

JOB = 5
QUIET_MS = 300 + 50 + 2  # of CLUTCH_S, the time between two answers, and the reaction
AT_MS = 600  # of the defect, in full motion


class Up:
    """A policy that asks both arms to rise at 0.2 m/s; `defect` answers from AT_MS on in its place."""

    def __init__(self, defect=None):
        self._defect = defect
        self.begin = None

    def act(self, observation):
        self.begin = observation.pose_ref.copy() if self.begin is None else self.begin
        if self._defect is not None and observation.t_s >= 1e-3 * AT_MS:
            return self._defect(observation)
        poses = np.repeat(self.begin[None], 10, axis=0)
        poses[:, :, 2] += (0.2 * (observation.t_s + 0.05 * np.arange(1, 11)))[:, None]
        return Chunk(0.05, poses)

    def close(self):
        pass


class Hand:
    """The person beside the policy: a watchdog that never trips. `script(ms, hand)` acts each tick."""

    def __init__(self, mailbox, script, clock):
        self._mailbox, self._script, self.clock = mailbox, script, clock
        self._target = np.zeros(1, TARGET)
        self._target["job"], self._target["speed"], self._target["stiffness"] = JOB, 0.3, 300.0
        self.ms = -1

    def trip(self):
        self.ms += 1
        self._script(self.ms, self)

    def hold(self, poses):
        self._target["pose"][0], self._target["clutch_ns"], self._target["policy"] = poses, self.clock(), 0
        self._mailbox.write_target(self._target)

    def lend(self, lease):
        self._target["clutch_ns"], self._target["policy"] = 0, lease
        self._mailbox.write_target(self._target)


@pytest.fixture
def led(cell, tmp_path):
    """Let a policy lead, beside a person; return the result, and the log."""
    mailbox = Mailbox.create(f"rtstack-test-policy-{os.getpid()}")

    def run(policy, script=None, longest_s=1.5, observer=None, **options):
        host = PolicyHost(policy, mailbox, JOB, 20.0, longest_s, **options)
        path = Path(tmp_path) / "policy.mcap"
        specification = TeleoperationSpecification("a policy", job=JOB)
        opened = open_cell("direct", "rice_box", 0.0, 0)
        log = open_log(path, specification, cell, "direct", default_cell_file(), overwrite=True)
        watchdogs = () if script is None else (Hand(mailbox, script, host.clock),)
        try:
            context = RunContext(log, watchdogs=watchdogs, run_observer=observer)
            result = run_teleoperation(specification, cell, opened, mailbox, context, clock=host.clock, host=host)
        finally:
            opened.close()
        return result, read_log(path)

    yield run
    mailbox.close()


def height(log, side="left"):
    """How far the command has risen, m, by tick."""
    z = log.topic(f"/{side}/control")["pose_ref"][:, 2]
    return z - z[0]


def told(log, text):
    """Ticks of the events that begin with a text."""
    begin_ns = log.topic("/left/arm")["t_ns"][0]
    return [round((event.t_ns - begin_ns) / 1e6) for event in log.events if event.text.startswith(text)]


def test_a_policy_leads_both_arms_through_the_filter_and_all_of_it_is_logged(led):
    result, log = led(Up())
    assert (result.success, result.failure_reason, result.moved) == (True, None, True)
    assert told(log, "a policy leads, lease 1") == [0]
    for side in ("left", "right"):
        rise = height(log, side)
        assert rise[1000] == pytest.approx(0.2, abs=0.05)  # the filter is 0.1 s behind
        assert np.abs(np.diff(rise[:1400], 2)).max() < 2 * 0.4 / 0.1 * 1e-6  # twice the speed over SMOOTH_S, (1 ms)^2
    assert set(log.topic("/left/control")["mode"]) == {Mode.TELEOPERATION, Mode.STOPPING}


def raises(_observation):
    raise RuntimeError("a defect of the policy's own")


def not_numbers(observation):
    return Chunk(0.05, np.full((3, 2, 7), np.nan))


def of_another_shape(observation):
    return Chunk(0.05, np.zeros((3, 7)))


@pytest.mark.parametrize(
    ("defect", "said"),
    [
        (lambda observation: None, ""), (raises, "the policy has ended: RuntimeError"),
        (not_numbers, "answers are not followed"),
        pytest.param(of_another_shape, "answers are not followed", marks=pytest.mark.long),
    ],
    ids=["hangs", "dies", "not numbers", "another shape"],
)  # fmt: skip
def test_a_policy_without_an_answer_that_can_be_followed_stops_the_arms_as_a_lost_operator_does(led, defect, said):
    result, log = led(Up(defect))
    assert not result.success
    assert result.failure_reason.startswith(str(End.POLICY_QUIET))
    samples = log.topic("/left/control")
    stopped = int(np.flatnonzero(samples["mode"] == Mode.STOPPING)[0])
    assert AT_MS < stopped <= AT_MS + QUIET_MS
    assert np.linalg.norm(samples["twist_ref"][AT_MS][:3]) > 0.15  # it was in full motion
    assert told(log, said)
    if defect is raises:  # its own words, and where
        at = raises.__code__.co_firstlineno + 1
        place = f"(test_policies.py:{at}); mend it there"
        assert f"RuntimeError: a defect of the policy's own {place}" in result.failure_reason
    elif said:
        assert said in result.failure_reason
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.02


def test_a_policy_elsewhere_that_has_failed_fails_the_result_in_its_own_words_whatever_ends_the_run(led):
    words = "grabber: the policy has ended: ValueError: no such object (/lab/policy.py:12)"
    events = [RunEvent(Level.WARNING, "operator", "anna took over"), RunEvent(Level.ERROR, "operator", words)]
    result, log = led(Up(), observer=SimpleNamespace(run_events=lambda: iter(events), ended=lambda *_: events.clear()))
    assert (result.success, result.failure_reason) == (False, words)
    assert (log.metadata["result"]["success"], log.metadata["result"]["failure_reason"]) == ("false", words)
    assert End.in_reason(words) is End.COMPLETED  # no fault: the arms hold


@pytest.mark.parametrize(("delay_s", "follows"), [(0.1, True), (0.25, True), (0.4, False)])
def test_a_late_answer_is_followed_from_where_it_is_due_and_one_that_is_too_late_not_at_all(led, delay_s, follows):
    result, log = led(Up(), delay_s=delay_s)
    assert result.success == follows, result.failure_reason
    if follows:
        assert height(log)[1400] == pytest.approx(0.2 * 1.4, abs=0.06)
    else:
        assert np.abs(height(log)).max() < 1e-9
        assert len(log.topic("/left/arm")) < 1000


def test_a_flood_of_answers_is_one_answer_a_tick_and_those_without_the_lease_are_none(led, cell):
    def script(ms, hand):
        for lease in (1, 7):
            chunk = Chunk(0.05, np.repeat(np.array([[[0, 0.3, 0.4, 1, 0, 0, 0]] * 2], float), 3, axis=0)).record(
                {"left": None, "right": None}, 0
            )
            chunk["job"], chunk["lease"], chunk["observed_ns"] = JOB, lease + 10 * (ms % 2), hand.clock()
            for _ in range(50):
                hand._mailbox.write_chunk(chunk)

    result, log = led(Up(), script)
    assert result.failure_reason.startswith(str(End.POLICY_QUIET))  # the flood hides the answers that count
    assert np.abs(height(log)).max() < 1e-9
    assert result.duration_s < 0.4 + 0.3


def test_a_person_takes_over_within_a_tick_and_gives_back(led):
    took, gave, poses = 500, 900, []

    def script(ms, hand):
        if ms == took:
            poses[:] = [np.zeros((2, 7))]
            poses[0][:] = policy.begin  # back down
        if took <= ms < gave and (ms - took) % 50 == 0:
            hand.hold(poses[0])
        if ms == gave:
            hand.lend(2)

    policy = Up()
    result, log = led(policy, script)
    assert result.success, result.failure_reason
    assert told(log, "the operator leads") == [took]  # the very tick in which the clutch was held
    assert [event.text for event in log.events if event.text.startswith("the operator leads")] == [
        "the operator leads: the clutch was held 0.000 ms before this tick"
    ]
    assert told(log, "a policy leads, lease 2") == [gave]
    rise = height(log)
    assert np.diff(rise)[took - 1] > 1e-4  # rising
    assert np.diff(rise)[took + 160 : gave].max() <= 0.0  # after the filter: down, whatever the policy asks for
    assert np.diff(rise)[gave + 160 : 1400].min() > 0.0


def test_joints_are_asked_for_as_the_pose_that_the_pads_have_there_and_the_posture(led, cell):
    models = ArmModel(cell.left, cell.pad), ArmModel(cell.right, cell.pad)
    wanted = np.array([cell.left.home, cell.right.home])
    wanted[:, 0] += -0.08, 0.08  # inwards
    wanted[:, 3] += 0.1  # and up

    class Joints(Up):
        def act(self, observation):
            return Chunk(0.05, joints=np.repeat(wanted[None], 4, axis=0))

    result, log = led(Joints(), longest_s=2.0)
    assert result.success, result.failure_reason
    for side, model, q in zip(("left", "right"), models, wanted, strict=True):
        asked = log.topic(f"/{side}/control")["pose_ref"][1900]
        np.testing.assert_allclose(asked[:3], pad_pose(model, q)[:3], atol=1e-3)
        assert log.topic(f"/{side}/arm")["q"][1900, 0] == pytest.approx(q[0], abs=0.02)


def test_a_cell_with_clocks_of_its_own_is_not_led_from_its_own_process(cell):
    from dataclasses import replace

    from rtstack.trials.errors import TrialError

    opened = open_cell("direct", "rice_box", 0.0, 0)
    try:
        with pytest.raises(TrialError, match="does not wait for a policy"):
            run_policy(Up(), TeleoperationSpecification("a"), cell, replace(opened, own_clocks=True))
    finally:
        opened.close()


def test_the_scripted_policy_grabs_an_object_that_is_not_in_its_place():
    place = Displacement.given(30.0, 20.0, 5.0)
    result, values, reason = run_watched(scripted_way(0, place), place, 1)
    assert (reason, result.safety_interventions) == (None, 0)
    assert values.max_lift_mm > 150.0
