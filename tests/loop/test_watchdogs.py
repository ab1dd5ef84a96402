"""Every watchdog of the loop trips in a real session on the plant, and the judge stops both arms within two ticks."""

import os
import re
import resource
import signal
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import rtstack.loop.standstill
import rtstack.trials.record
import rtstack.trials.run
from hal.cell import Cell
from hal.errors import ConnectionLost
from rtstack.cells import open_cell
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.log.writer import LogProcess
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import (
    CONSOLE_S,
    FIRST_TORQUE_TICKS,
    OPERATOR_S,
    OVERRUN_TICKS,
    FirstTorque,
    Heartbeat,
    LostAnswers,
    TickOverrun,
)
from rtstack.safety.judge import Judgement
from rtstack.samples import Level, QpStatus
from rtstack.trials.record import TrialLog
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

AT = 300  # tick of the fault, both arms on their way to the box
MOST_TICKS = 2


class EachTick:
    """Asked as a watchdog is, once a tick, after the observation; does something, and finds nothing."""

    def __init__(self, act) -> None:
        self._act = act
        self._tick = -1

    def trip(self) -> None:
        self._tick += 1
        self._act(self._tick)


@dataclass
class Played:
    """What a trial with a fault was: ticks (n,) of the left arm, verdicts of both, its ERROR events."""

    reason: str
    ticks: np.ndarray
    verdicts: list[list[Judgement]]
    errors: list[tuple[int, str]]

    def stops(self, reason: str) -> int:
        """Assert that the fault was seen, said and answered; return the tick that saw it."""
        assert re.search(reason, self.reason), self.reason
        assert len(self.errors) == 1, self.errors
        assert re.search(reason, self.errors[0][1]), self.errors
        seen = int(np.flatnonzero(self.ticks["t_ns"] == self.errors[0][0])[0])
        for verdicts in self.verdicts:
            first = verdicts.index(Judgement.STOPPING)
            assert 0 <= first - seen <= MOST_TICKS
            assert set(verdicts[first:]) == {Judgement.STOPPING}
        first = self.verdicts[0].index(Judgement.STOPPING)
        assert np.any(self.ticks["tau_applied"][first] != self.ticks["tau_desired"][first])
        assert np.all(np.isfinite(self.ticks["tau_applied"]))
        assert np.abs(self.ticks["dq"][-1]).max() < rtstack.loop.standstill.REST_DQ
        return seen


class Stage:
    """Plays trials on the direct plant, with the controller and the judges that a run really makes in reach."""

    def __init__(self, monkeypatch, prepared) -> None:
        self._prepared = prepared
        self.verdicts: list[list[Judgement]] = [[], []]
        make_controller, make_judges = rtstack.trials.run.cell_controller, rtstack.trials.run.safety_judges

        def controller(*arguments):
            self.controller = make_controller(*arguments)
            return self.controller

        def judges(*arguments):
            made = make_judges(*arguments)
            for verdicts, judge in zip(self.verdicts, made, strict=True):
                judge.judge = _recording(judge.judge, verdicts)
            return made

        monkeypatch.setattr(rtstack.trials.run, "cell_controller", controller)
        monkeypatch.setattr(rtstack.trials.run, "safety_judges", judges)
        monkeypatch.setattr(rtstack.trials.run, "realtime_thread", nullcontext)

    def play(self, act=lambda tick: None, change=lambda cell: cell, watchdogs=(), log=None, **around) -> Played:
        """Run the trial; `act` is called in each tick, `change` may wrap the cell."""
        cell: Cell = open_cell("direct", "rice_box", 0.0, 1)
        try:
            with Rings.create() as live:
                context = RunContext(log, live, watchdogs=(EachTick(act), *watchdogs), **around)
                result = run_trial(self._prepared, change(cell), context)
                ticks = live.log_reader("/left/arm").drain()
                events = live.log_reader("/events").drain()
        finally:
            cell.close()
        errors = [(int(e["t_ns"]), bytes(e["text"]).decode()) for e in events if e["level"] >= Level.ERROR]
        assert result.success == (not errors) or result.failure_reason
        return Played(str(result.failure_reason), ticks, self.verdicts, errors)


def _recording(judge, verdicts):
    def judged(*arguments):
        verdicts.append(judge(*arguments))
        return verdicts[-1]

    return judged


@pytest.fixture(scope="module")
def prepared(cell, demonstration):
    return prepare_trial(TrialSpecification(str(demonstration.path), seed=1), cell)


@pytest.fixture
def stage(monkeypatch, prepared) -> Stage:
    return Stage(monkeypatch, prepared)


def _at(act, tick: int = AT):
    return lambda now: act() if now == tick else None


def test_a_stop_is_taken_within_two_turns_of_the_loop(stage):
    stop, came, taken = Mailbox.create(f"taken-{os.getpid()}"), [], []

    def act(tick: int) -> None:
        if tick == AT + 40:  # progress is told every 50 ticks
            came.append(stop.request_stop())
            between(0.0)

    def between(fraction: float) -> None:
        taken.extend(stop.stop_taken(turn) for turn in came)

    played = stage.play(act, stop=stop, progress=between)
    assert "stop requested by the operator" in played.reason
    assert came == [AT + 41]
    assert taken[:2] == [False, True]
    assert stop.request_stop() == 0  # no session is left
    stop.close()


def test_a_good_trial_trips_none(stage):
    played = stage.play()
    assert played.reason == "None"
    assert played.errors == []


@pytest.mark.parametrize("method", ["observe", "choose", "command", "decide", "finish"])
def test_an_exception_of_the_controller_stops_without_it(stage, method):
    calls = []

    def broken(*_):
        calls.append(method)
        raise ZeroDivisionError("a defect")

    def spoil():
        arm = stage.controller.arms[1]
        owner = {"observe": arm, "command": arm.law}.get(method, stage.controller)
        setattr(owner, method, broken)

    played = stage.play(_at(spoil))
    seen = played.stops(
        r"^an exception in the control loop: ZeroDivisionError: a defect \(test_watchdogs\.py:\d+\); mend it there$"
    )
    assert seen == AT + (method in ("observe", "decide"))
    assert calls == [method]  # never asked again


@pytest.mark.parametrize("status", [QpStatus.INFEASIBLE, QpStatus.ITERATIONS_EXHAUSTED, QpStatus.WRONG_ANSWER])
def test_a_qp_without_an_answer_stops(stage, status):
    class Program:
        def solve(self, *problem):
            problem[-1][:] = np.nan
            return status, 7

    def spoil():
        arm = stage.controller.arms[0]
        arm.law.program = Program()
        arm.limits["tau_J_max"] = 1e-3  # no free solution

    assert stage.play(_at(spoil)).stops(f"^the QP was not solved: {status.name.lower()}$") == AT


def test_a_torque_that_is_no_number_stops(stage):
    def spoil():
        command = stage.controller.arms[0].law.command

        def broken(mode):
            status = command(mode)
            stage.controller.arms[0].sample["tau_desired"][0, 3] = np.nan
            return status

        stage.controller.arms[0].law.command = broken

    assert stage.play(_at(spoil)).stops("^safety stop: left: joint 4: the desired torque is nan$") == AT


class WrappedArm:
    """An arm whose states are spoilt from one read on."""

    def __init__(self, arm, spoil) -> None:
        self._arm, self._spoil, self._reads = arm, spoil, 0
        self.write, self.stop, self.close, self.recover = arm.write, arm.stop, arm.close, arm.recover

    def read(self):
        state = self._arm.read()
        self._reads += 1
        if self._reads > AT:
            self._spoil(state.record)
        return state


def test_a_stale_state_stops(stage):
    kept = {}

    def freeze(record):
        kept.setdefault("state", record.copy())
        t_ns = record["t_ns"].copy()
        record[:] = kept["state"]
        record["t_ns"] = t_ns

    played = stage.play(change=lambda cell: replace(cell, right=WrappedArm(cell.right, freeze)))
    first = played.stops("^safety stop: right: the state is stale")
    assert first <= AT + 21
    assert len(played.ticks) <= first + 2  # by that state nobody can brake: the robot does


def test_a_lost_arm_ends_the_session_and_says_which(stage):
    def lose(record):
        raise ConnectionLost("the arm at 172.16.0.3 has sent no state for 100 ms")

    played = stage.play(change=lambda cell: replace(cell, right=WrappedArm(cell.right, lose)))
    assert played.reason == "the robot left torque control: the arm at 172.16.0.3 has sent no state for 100 ms"
    assert [text for _, text in played.errors] == ["the arm at 172.16.0.3 has sent no state for 100 ms"]


@pytest.mark.parametrize("who", ["operator", "console"])
def test_who_gives_no_sign_of_life_any_more_stops_the_arms(stage, who):
    limit_s, end = (OPERATOR_S, End.OPERATOR_GONE) if who == "operator" else (CONSOLE_S, End.CONSOLE_GONE)
    box = Mailbox.create(f"rtstack-test-{os.getpid()}-{who}")
    beat = getattr(box, f"{who}_beat")

    def live_until_at(tick):
        silence_ns = round(1.5e9 * limit_s) if tick >= AT else 0
        beat(time.monotonic_ns() - silence_ns)

    try:
        watchdog = Heartbeat(lambda: getattr(box, f"{who}_beat_ns"), limit_s, end)
        never = watchdog.trip()
        assert never is not None
        assert never.detail == f"no signal yet (limit {limit_s:g} s)"
        played = stage.play(live_until_at, watchdogs=(watchdog,))
    finally:
        box.close()
    assert played.stops(rf"^{end}: no signal for [\d.]+ s \(limit {limit_s:g} s\)$") == AT


def test_ticks_that_take_longer_than_a_period_stop_without_the_controller(stage):
    calls = []

    def spoil():
        observe = stage.controller.arms[0].observe

        def slow():
            calls.append(time.sleep(2e-3))  # the fault itself
            observe()

        stage.controller.arms[0].observe = slow

    played = stage.play(_at(spoil), change=lambda cell: replace(cell, own_clocks=True))
    played.stops(rf"^the tick takes longer than its period: {OVERRUN_TICKS} ticks in a row")
    assert OVERRUN_TICKS <= len(calls) <= OVERRUN_TICKS + 1


def test_a_machine_that_stalls_now_and_then_is_no_overrun():
    overrun = TickOverrun()
    for tick in range(1000):
        overrun.take((tick % 2,), 20_000_000 if tick % 17 == 0 else 200_000)
        assert overrun.trip() is None


def test_one_slow_arm_of_two_is_an_overrun():
    overrun = TickOverrun()
    for _ in range(OVERRUN_TICKS):
        assert overrun.trip() is None
        overrun.take((0,), 1_100_000)
        overrun.take((1,), 100_000)
    assert overrun.trip() is not None


def test_an_exception_between_two_ticks_stops_too(stage):
    def progress(fraction):
        if fraction > 0.05:
            raise BrokenPipeError("nobody reads any more")

    stage.play(progress=progress).stops(
        r"^an exception in the control loop: BrokenPipeError: nobody reads any more "
        r"\(test_watchdogs\.py:\d+\); mend it there$"
    )


def test_arms_that_do_not_come_to_rest_are_a_fault(stage, monkeypatch):
    monkeypatch.setattr(rtstack.loop.standstill, "STOP_TICKS", 10)

    class Stop:
        stop_requested = False

    stop = Stop()
    played = stage.play(_at(lambda: setattr(stop, "stop_requested", True)), stop=stop)
    assert re.search(r"^the arms did not come to rest: still [\d.]+ rad/s", played.reason)
    assert [text for _, text in played.errors] == [played.reason]


@pytest.fixture
def log(tmp_path: Path):
    """A log in a process of its own, with rings of half a second."""
    rings = Rings.create(512)
    process = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": {"seed": "1"}})
    yield TrialLog(tmp_path / "a.mcap", rings, process, lockstep=True), process
    process.abandon()
    rings.close()


def _dead(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def test_a_log_process_that_is_killed_stops_the_arms(stage, log):
    def kill():
        os.kill(log[1].pid, signal.SIGKILL)
        while not _dead(log[1].pid):
            time.sleep(1e-3)

    played = stage.play(_at(kill), log=log[0])
    assert read_log(log[0].path).complete  # what the rings held is in it
    seen = played.stops("^the log is not being written: its process was killed by signal 9$")
    assert seen <= AT + rtstack.trials.run.ROOM_TICKS + 1


def test_a_log_that_hangs_stops_a_run_that_would_wait_for_it(stage, log, monkeypatch):
    monkeypatch.setattr(rtstack.trials.record, "HANG_S", 0.3)
    monkeypatch.setattr(rtstack.trials.record, "_END_OF_HANGING_S", 0.1)
    played = stage.play(_at(lambda: os.kill(log[1].pid, signal.SIGSTOP)), log=log[0])
    played.reason = played.errors[0][1]
    played.stops("^the log is not being written: its process has read nothing for 0.3 s$")


def test_a_ring_that_fills_up_stops_a_run_that_cannot_wait(stage, log, monkeypatch):
    monkeypatch.setattr(rtstack.trials.record, "_END_OF_HANGING_S", 0.1)
    hurried = TrialLog(log[0].path, log[0].rings, log[1], lockstep=False)
    lost = []

    def look(tick):
        if tick == 0:
            os.kill(log[1].pid, signal.SIGSTOP)
        lost.append(hurried.rings.room() == 0)

    played = stage.play(look, log=hurried)
    played.reason = played.errors[0][1]
    seen = played.stops(r"^the log is not being written: its process is \d+ records behind, 512 is all that can wait$")
    assert 256 <= seen <= 256 + 2 * rtstack.trials.run.ROOM_TICKS
    assert not any(lost)


def test_a_disk_that_is_full_stops_the_arms(stage, log):
    def fill():
        size = os.path.getsize(log[0].path)
        resource.prlimit(log[1].pid, resource.RLIMIT_FSIZE, (size, size))

    played = stage.play(_at(fill), log=log[0])
    assert played.stops(r"^the log (is not being|.* cannot be) written: File too large$") > AT


def test_a_log_that_says_that_it_failed_is_seen_at_once(log):
    assert log[0].trip() is None
    log[0].rings.fail("No space left on device")
    trip = log[0].trip()
    assert trip is not None  # not compared whole: since Python 3.13 a NaN in it makes it differ from its equal
    assert (trip.end, trip.detail) == (End.LOG_FAILED, "No space left on device")


@dataclass
class Echo:
    """What an arm has shown of our torques."""

    seen: bool
    lost: int


def test_an_arm_whose_first_torques_do_not_come_back_ends_the_other_ones_motion():
    silent = FirstTorque({"left": Echo(seen=False, lost=FIRST_TORQUE_TICKS), "right": Echo(seen=True, lost=0)}).trip()
    assert silent is not None
    assert (silent.end, silent.side, silent.end.is_fault) == (End.TORQUE_NOT_TAKEN, "left", True)
    lost = FIRST_TORQUE_TICKS
    for left, right in ((False, False), (True, True)):  # nothing moves; late answers are the robot's to count
        assert FirstTorque({"left": Echo(left, lost), "right": Echo(right, lost)}).trip() is None
    early = {"left": Echo(seen=True, lost=0), "right": Echo(seen=False, lost=lost - 1)}
    assert FirstTorque(early).trip() is None
    assert FirstTorque({"right": Echo(seen=False, lost=lost)}).trip() is None  # there is no other arm


def test_a_link_that_loses_more_than_a_quarter_of_its_answers_ends_the_motion():
    left, right = Echo(seen=True, lost=0), Echo(seen=True, lost=0)
    watchdog = LostAnswers({"left": left, "right": right})
    for tick in range(3000):
        left.lost += tick % 5 == 0
        assert watchdog.trip() is None  # once for each arm's state
        assert watchdog.trip() is None
    trips = []
    for _ in range(400):
        right.lost += 1
        trips += [watchdog.trip(), watchdog.trip()]
    first = next(trip for trip in trips if trip is not None)
    assert trips.index(first) / 2 == pytest.approx(300, abs=100)  # ms: as soon as more than 250 are lost
    assert (first.end, first.side, first.end.is_fault) == (End.TORQUE_NOT_TAKEN, "right", True)
