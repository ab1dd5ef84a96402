"""The control authority: in any order of what operators and the loop do, nothing moves after a STOP before an operator
has armed again, and each permission is in the audit trail.
"""

import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from rtstack.live.audit import AuditTrail
from rtstack.live.control_authority import ControlAuthority
from rtstack.loop.mailbox import Mailbox, remove_mailbox
from rtstack.safety.arming import LEASE_S, Phase, Refused
from rtstack.samples import Level

operators = st.sampled_from(["anna", "ben"])
numbers = itertools.count()


class Bench:
    """A control authority with a clock that is turned by hand."""

    def __init__(self, trail: Path) -> None:
        name = f"rtstack-test-authority-{os.getpid()}-{next(numbers)}"
        remove_mailbox(name)
        self.now_s = 1000.0
        self.trail = trail
        self.mailbox = Mailbox.create(name)
        self.audit = AuditTrail(trail)
        self.authority = ControlAuthority(self.mailbox, self.audit, lambda: self.now_s)

    def lines(self):
        return [json.loads(line) for line in self.trail.read_text().splitlines()]

    def close(self):
        self.audit.close()
        self.mailbox.close()


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path / "audit.jsonl")
    yield bench
    bench.close()


class HelmMachine(RuleBasedStateMachine):
    """Operators, a STOP in the mailbox, faults and time, in any order."""

    @initialize()
    def start(self):
        self.folder = tempfile.TemporaryDirectory()
        self.bench = Bench(Path(self.folder.name) / "audit.jsonl")
        self.authority, self.mailbox = self.bench.authority, self.bench.mailbox
        self.armed_by = None  # who has armed since the last reason not to move
        self.moving = False
        self.allowed = []

    def teardown(self):
        if hasattr(self, "bench"):
            self.bench.close()
            self.folder.cleanup()

    def tries(self, action, who):
        refusal = self.refusal(lambda: getattr(self.authority, action)(who))
        if refusal is None:
            self.allowed.append((action, who))
        return refusal is None

    def refusal(self, act):
        try:
            act()
        except Refused as refused:
            line = str(refused)
        else:
            return None
        assert "\n" not in line
        return line

    @rule(who=operators, over=st.none() | operators)
    def takes(self, who, over):
        before = self.authority.view().holder
        refusal = self.refusal(lambda: self.authority.take(who, over))
        if refusal is not None:
            assert before not in (None, who)
            assert before in refusal
            assert over != before or self.moving
            return
        assert before in (None, who, over)
        assert before in (None, who) or not self.moving
        if before != who:
            self.allowed.append(("take" if before is None else "takeover", who))
            self.armed_by = None

    @rule(who=operators)
    def releases(self, who):
        if self.tries("release", who):
            self.armed_by = None
            assert self.mailbox.stop_requested or not self.moving

    @rule(who=operators)
    def arms(self, who):
        if self.tries("arm", who):
            assert self.authority.view().holder == who
            assert not self.mailbox.stop_requested
            if self.armed_by == who:
                self.allowed.pop()  # it was armed
            self.armed_by = who

    @rule(who=operators)
    def disarms(self, who):
        assert self.tries("disarm", who)
        self.armed_by = None
        assert self.mailbox.stop_requested or not self.moving

    @rule(who=operators)
    def stops(self, who):
        assert self.tries("stop", who)
        self.armed_by = None
        assert self.mailbox.stop_requested

    @rule()
    def somebody_writes_stop_into_the_mailbox(self):
        self.mailbox.request_stop()
        self.armed_by = None

    @rule(who=operators)
    def begins(self, who):
        if self.refusal(lambda: self.authority.begin(who, "a trial")) is not None:
            return
        assert self.armed_by == who
        assert not self.moving
        assert not self.mailbox.stop_requested
        self.allowed.append(("begin", who))
        self.moving = True

    @rule(who=operators)
    def goes_for_it(self, who):
        self.takes(who, None)
        self.arms(who)
        self.begins(who)

    @rule()
    def the_motion_ends(self):
        self.authority.end()
        self.moving = False

    @rule()
    def a_fault_comes(self):
        self.authority.fault("reflex")
        self.armed_by = None

    @rule(who=operators, ends_well=st.booleans())
    def recovers(self, who, ends_well):
        if self.tries("recover", who):
            assert not self.moving
            if ends_well:
                self.authority.recovered()
            else:
                self.authority.not_recovered("persists")
        assert self.armed_by is None or self.authority.view().phase is not Phase.RECOVERING

    @rule(seconds=st.sampled_from([0.1, LEASE_S / 2, LEASE_S * 1.01]), alive=st.booleans())
    def time_passes(self, seconds, alive):
        self.bench.now_s += seconds
        holder = self.authority.view().holder
        if alive and holder:
            self.authority.beat(holder)
        self.authority.watch()
        if holder is None:
            self.armed_by = None

    @invariant()
    def nothing_is_armed_that_nobody_has_armed(self):
        if hasattr(self, "bench"):
            self.authority.watch()
            view = self.authority.view()
            if view.holder is None:
                self.armed_by = None
            if view.phase is Phase.ARMED:
                assert self.armed_by == view.holder
                assert not self.mailbox.stop_requested

    @invariant()
    def whatever_was_allowed_is_in_the_trail(self):
        if hasattr(self, "bench"):
            noted = [(line["action"], line["operator"]) for line in self.bench.lines()]
            own = ("take", "takeover", "release", "arm", "disarm", "stop", "begin", "recover")
            assert [entry for entry in noted if entry[0] in own] == self.allowed


HelmMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
TestHelm = HelmMachine.TestCase


def test_a_motion_without_its_operator_stops_although_the_loop_says_nothing(bench):
    bench.authority.take("anna")
    bench.authority.arm("anna")
    bench.authority.begin("anna", "a trial")
    bench.now_s += LEASE_S * 1.01
    bench.authority.watch()
    assert not bench.mailbox.stop_requested  # the loop's own watchdog knows the reason, and comes first
    bench.now_s += 1.0
    bench.authority.watch()
    bench.authority.watch()
    assert bench.mailbox.stop_requested
    assert bench.authority.view().holder is None
    assert [line["action"] for line in bench.lines()] == ["take", "arm", "begin", "lost"]


def test_only_the_holders_beat_reaches_the_loop(bench):
    bench.authority.beat("ben")
    assert bench.mailbox.operator_beat_ns == 0
    bench.authority.take("anna")
    taken_ns = bench.mailbox.operator_beat_ns
    assert 0 < taken_ns <= time.monotonic_ns()
    bench.now_s += 1.0
    bench.authority.beat("ben")
    assert bench.mailbox.operator_beat_ns == taken_ns
    bench.authority.beat("anna")
    assert bench.mailbox.operator_beat_ns > taken_ns


def test_what_operators_do_is_told_once_with_their_names(bench):
    bench.authority.take("anna")
    bench.authority.take("ben", over_from="anna")
    bench.authority.stop("carl")
    told = [(run_event.level, run_event.name, run_event.text) for run_event in bench.authority.run_events()]
    assert told == [
        (Level.INFO, "operator", "anna took control"),
        (Level.WARNING, "operator", "ben took over from anna"),
        (Level.WARNING, "operator", "carl pressed STOP"),
    ]
    assert list(bench.authority.run_events()) == []


def test_the_trail_goes_on_after_a_line_that_was_cut(tmp_path):
    path = tmp_path / "audit.jsonl"
    path.write_bytes(b'{"action": "take"}\n{"acti')
    trail = AuditTrail(path)
    trail.note("stop", "Zoë", "Zoë pressed STOP")
    trail.close()
    lines = path.read_text().splitlines()
    assert len(lines) == 3
    assert json.loads(lines[2])["operator"] == "Zoë"


@pytest.mark.parametrize("folder", ["moved", "replaced"])
def test_the_trail_follows_its_folder(tmp_path, folder):
    logs, elsewhere = tmp_path / "logs", tmp_path / "elsewhere"
    logs.mkdir()
    trail = AuditTrail(logs / "audit.jsonl")
    trail.note("take", "anna", "1")
    logs.rename(elsewhere)
    trail.note("arm", "anna", "2")  # there is no folder: the file that is open goes on
    if folder == "replaced":
        logs.mkdir()
    else:
        elsewhere.rename(logs)
    trail.note("stop", "anna", "3")
    (logs / "audit.jsonl").unlink()
    trail.note("stop", "anna", "4")
    assert [line.text for line in trail.newest(10)] == ["4"]
    trail.close()
    if folder == "replaced":
        assert [json.loads(line)["text"] for line in (elsewhere / "audit.jsonl").read_text().splitlines()] == ["1", "2"]


def test_no_line_of_the_trail_is_lost_to_a_full_disk(tmp_path):
    """A process of its own: the limit of a file's size cuts a line in the middle, as a full disk does."""
    code = """
import resource, signal, sys
from pathlib import Path
from rtstack.live.audit import AuditTrail
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
trail = AuditTrail(Path(sys.argv[1]))
for number in range(30):
    room = 1000 if number < 20 else resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
    trail.note("stop", "anna", str(number))
    assert [line.text for line in trail.newest(2)][-1] == str(number)
trail.close()
"""
    path = tmp_path / "audit.jsonl"
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    lines = path.read_text().splitlines()
    whole = [json.loads(line)["text"] for line in lines if line.endswith("}")]
    assert whole == [str(number) for number in range(30)]
    assert len(lines) == 31  # one was cut, and written again
    assert (done.stderr.count("\n"), "audit.jsonl" in done.stderr) == (1, True)


def test_a_stop_counts_at_once_for_the_next_order(bench):
    bench.authority.take("anna")
    bench.authority.arm("anna")
    bench.authority.stop("ben")
    assert bench.authority.view().phase is Phase.DISARMED
    bench.authority.arm("anna")
    bench.mailbox.request_stop()  # and the control authority was not called since
    with pytest.raises(Refused, match="STOP was pressed"):
        bench.authority.arm("anna")
    bench.authority.arm("anna")
    bench.mailbox.request_stop()
    with pytest.raises(Refused, match="arm them first"):
        bench.authority.begin("anna", "a trial")


def test_nobody_takes_over_from_a_motion_or_from_somebody_else_than_named(bench):
    bench.authority.take("anna")
    with pytest.raises(Refused, match="anna has control"):
        bench.authority.take("ben", over_from="carl")
    bench.authority.arm("anna")
    bench.authority.begin("anna", "a trial")
    with pytest.raises(Refused, match="the arms are moving: take over from anna once they are at rest"):
        bench.authority.take("ben", over_from="anna")
    assert bench.authority.view().holder == "anna"
    assert not bench.mailbox.stop_requested


def test_a_stop_in_a_fault_is_not_lost_to_a_guide_that_was_ordered_at_the_same_time(bench):
    authority, mailbox = bench.authority, bench.mailbox
    authority.take("anna")
    authority.fault("safety stop: left arm: the end effector is too fast")
    mailbox.request_stop()  # of the motion that ended so
    authority.stop("ben")
    with pytest.raises(Refused, match="STOP was pressed a moment ago"):
        authority.begin("anna", "guide 1: by hand", by_hand=True)
    assert mailbox.stop_requested
    bench.now_s += 1.1
    authority.beat("anna")
    authority.begin("anna", "guide 2: by hand", by_hand=True)
    assert not mailbox.stop_requested
    authority.stop("ben")  # whose report comes after the order
    assert mailbox.stop_requested


def test_a_lease_ends_while_the_machine_is_suspended(tmp_path, monkeypatch):
    """The monotonic clock stands still meanwhile, and the signs of life would look fresh."""
    bench = Bench(tmp_path / "audit.jsonl")
    authority = ControlAuthority(bench.mailbox, bench.audit)
    authority.take("anna")
    authority.arm("anna")
    asleep_s = time.clock_gettime(time.CLOCK_BOOTTIME) + 3600.0
    monkeypatch.setattr(time, "clock_gettime", lambda clock: asleep_s if clock == time.CLOCK_BOOTTIME else 0.0)
    with pytest.raises(Refused, match="no operator has control"):
        authority.begin("anna", "a trial")
    assert not authority.armed
    bench.close()
