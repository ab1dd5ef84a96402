"""What the log keeps of a fault, and that a good trial leaves nothing of the kind."""

import os
import re
import signal
import subprocess
import sys
import time
from io import BytesIO

import numpy as np
import pytest

import rtstack.trials.record
import rtstack.trials.run
from rtstack.cells import open_cell
from rtstack.cli.review import review as print_review
from rtstack.log.errors import LogError
from rtstack.log.file.container import is_complete, open_mcap
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.log.writer import LogProcess
from rtstack.samples import QpStatus
from rtstack.trials.record import TrialLog
from rtstack.trials.review import review_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

AT = 1400  # tick of the fault, so that a whole second lies before it
MS = 1_000_000


class At:
    """A watchdog that finds nothing, and spoils something in one tick."""

    def __init__(self, tick: int, act) -> None:
        self._left, self._act = tick + 1, act

    def trip(self) -> None:
        self._left -= 1
        if self._left == 0:
            self._act()


@pytest.fixture
def controllers(monkeypatch):
    """The controllers that runs make, the last one last."""
    made = []
    make = rtstack.trials.run.cell_controller

    def keep(*arguments):
        made.append(make(*arguments))
        return made[-1]

    monkeypatch.setattr(rtstack.trials.run, "cell_controller", keep)
    return made


def _attachments(log) -> dict[str, bytes]:
    return {attachment.name: attachment.data for attachment in log.attachments}


def _npz(data: bytes):
    return np.load(BytesIO(data))


def test_a_good_trial_leaves_no_evidence(runner, tmp_path):
    path = tmp_path / "good.mcap"
    assert runner.run(log=path).success
    log = read_log(path)
    assert "fault" not in log.metadata
    assert _attachments(log).keys() == {"cell.toml", "fr3.urdf"}
    assert review_log(path).fault is None


def test_an_exception_leaves_its_traceback_and_the_last_second(runner, controllers, tmp_path, capsys):
    def spoil():
        controllers[-1].arms[0].law.command = lambda mode: 1 / 0

    path = tmp_path / "raised.mcap"
    result = runner.run(log=path, watchdogs=(At(AT, spoil),))
    raised = r"ZeroDivisionError: division by zero \(test_fault_evidence\.py:\d+\); mend it there"
    assert re.fullmatch(f"an exception in the control loop: {raised}", result.failure_reason)
    log = read_log(path)
    fault, files = log.metadata["fault"], _attachments(log)
    assert fault["end"] == "an exception in the control loop"
    assert re.fullmatch(raised, fault["detail"])
    assert fault["reaction_ticks"] == "0"
    assert fault["evidence"] == "last_second.npz, traceback.txt"
    arm = log.topic("/left/arm")
    assert int(fault["t_ns"]) == arm["t_ns"][AT]
    text = files["traceback.txt"].decode()
    assert "in _control" in text
    assert text.rstrip().endswith("ZeroDivisionError: division by zero")
    kept = _npz(files["last_second.npz"])
    assert int(kept["t_ns"]) == arm["t_ns"][AT]
    assert kept["arm"].shape == kept["control"].shape == (2, 1101)
    assert kept["arm"][0].tobytes() == arm[AT - 1000 : AT + 101].tobytes()
    assert len(kept["timing"]) == 1101
    assert len(kept["object"]) > 100
    assert review_log(path).as_dict()["fault"] == fault
    print_review(path)
    assert re.search(f"fault detail           {raised}\n", capsys.readouterr().out)


def test_a_qp_without_an_answer_is_kept_as_it_was(runner, controllers, tmp_path):
    given = []

    class Program:
        def solve(self, *problem):
            given.append([part.copy() for part in problem[:7]])
            return QpStatus.ITERATIONS_EXHAUSTED, 212

    def spoil():
        controllers[-1].arms[1].law.program = Program()
        controllers[-1].arms[1].limits["tau_J_max"] = 1e-3

    path = tmp_path / "qp.mcap"
    runner.run(log=path, watchdogs=(At(AT, spoil),))
    log = read_log(path)
    assert log.metadata["fault"]["end"] == "the QP was not solved"
    assert log.metadata["fault"]["side"] == "right"
    assert len(given) == 1
    kept = _npz(_attachments(log)["qp.npz"])
    for name, part in zip(("H", "g", "lower", "upper", "M", "tau_lower", "tau_upper"), given[0], strict=True):
        np.testing.assert_array_equal(kept[name], part)
    said = {name: str(kept[name]) for name in ("side", "status", "iterations", "solver")}
    assert said == {"side": "right", "status": "ITERATIONS_EXHAUSTED", "iterations": "212", "solver": "proxqp"}


def test_the_last_second_is_whole_where_the_log_has_lost_ticks(runner, tmp_path, monkeypatch):
    """A log process that hangs for a while in a run that cannot wait: the ring overflows."""
    monkeypatch.setattr(rtstack.trials.record, "_END_OF_HANGING_S", 30.0)
    path = tmp_path / "lost.mcap"
    rings = Rings.create(64)
    process = LogProcess.start(path, rings, {"trial": {"seed": "1"}})
    log = TrialLog(path, rings, process, lockstep=False)

    class RunObserver:
        def run_events(self):
            return ()

        def ended(self, end, detail):
            os.kill(process.pid, signal.SIGCONT)

    prepared = prepare_trial(TrialSpecification(str(runner.reference), seed=1), runner.cell)
    cell = open_cell("direct", "rice_box", 0.0, 1)
    try:
        watchdog = At(0, lambda: os.kill(process.pid, signal.SIGSTOP))
        run_trial(prepared, cell, RunContext(log, watchdogs=(watchdog,), run_observer=RunObserver()))
    finally:
        cell.close()
    found = read_log(path)
    assert int(found.metadata["log"]["lost"]) > 0
    assert found.metadata["fault"]["end"] == "the log is not being written"
    t_ns = _npz(_attachments(found)["last_second.npz"])["timing"]["t_ns"]
    assert len(t_ns) > 64
    assert set(np.diff(t_ns)) == {MS}
    assert t_ns[0] < found.topic("/left/arm")["t_ns"][0]


def test_a_headless_trial_ends_when_who_started_it_has_gone(runner, tmp_path):
    path = tmp_path / "orphan.mcap"
    command = [sys.executable, "-c", "from rtstack.cli.app import main; main()", "trial"]
    command += [f"--reference={runner.reference}", f"--log={path}"]
    parent = subprocess.Popen(
        [sys.executable, "-c", f"import subprocess; subprocess.run({command!r})"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        _wait(lambda: path.exists() and path.stat().st_size > 300_000)  # the first ticks are in the log
    finally:
        parent.kill()
        parent.wait()
    _wait(lambda: _complete(path))
    log = read_log(path)
    assert log.metadata["fault"]["end"] == "the process that started this one has gone"
    assert log.metadata["fault"]["detail"] == f"process {parent.pid} has ended"
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.02


def _wait(condition) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(5e-3)


def _complete(path) -> bool:
    with open_mcap(path) as file:
        return is_complete(file)


def test_evidence_is_recovered_from_a_log_that_is_cut_off_after_it(runner, controllers, tmp_path):
    from rtstack.log.file.recover import recover

    def spoil():
        controllers[-1].arms[0].law.command = lambda mode: 1 / 0

    path = tmp_path / "raised.mcap"
    runner.run(log=path, watchdogs=(At(20, spoil),))
    data = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: data.rindex(b"reaction_ticks") + 400])
    with pytest.raises(LogError, match="cut off"):
        read_log(cut)
    log = read_log(recover(cut).output)
    assert log.metadata["fault"]["detail"].startswith("ZeroDivisionError: division by zero (")
    assert "traceback.txt" in _attachments(log)


def test_a_run_that_is_given_up_on_finishes_its_log(runner, tmp_path):
    """What is no fault of the controller's, such as a second Ctrl-C, ends at once; the log is finished all the same."""
    path = tmp_path / "interrupted.mcap"

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        runner.run(log=path, watchdogs=(At(30, interrupt),))
    assert len(read_log(path).topic("/left/arm")) == 30
