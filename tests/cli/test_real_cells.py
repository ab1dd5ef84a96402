"""Arms that are not simulated on this machine: which set-ups are refused, and that a person holds the key meanwhile."""

import contextlib
import datetime
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hal.base.configuration import ConfigurationError
from hal.errors import HardwareError
from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import Interrupt
from rtstack.log.reader import read_log
from rtstack.samples import Mode
from rtstack.testing import ServedArms
from rtstack.trials.errors import TrialError
from tests.support.campaigns import two_controllers
from tests.support.real_cell import CALIBRATED, commission, write_cell_file
from tests.support.terminal import Terminal

LEFT, RIGHT = "192.0.2.2", "192.0.2.3"  # of a network that is nobody's (RFC 5737)
TODAY = datetime.date.today()
# the command, without its watchdogs of the time of day: the arms are in lockstep, and this machine may be slow
_PATIENT = """
import hal.fci.pair, rtstack.cli, rtstack.loop.watchdogs
hal.fci.pair.STALE_S = hal.fci.pair.STALE_IN_LOCKSTEP_S
rtstack.loop.watchdogs.OVERRUN_TICKS = 10_000
rtstack.cli.main()
"""
COMMAND = (sys.executable, "-c", _PATIENT)


def cell_file(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the description of a measured cell at LEFT and RIGHT, with changes."""
    path = folder / "cell.toml"
    text = write_cell_file(path, LEFT, RIGHT)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    with contextlib.suppress(ConfigurationError):
        commission(path)
    return path


def days(number: int) -> str:
    return str(TODAY + datetime.timedelta(days=number))


WRONG = {
    "no simulated arms": ([("simulated = false", "simulated = true")], LEFT, RIGHT, "simulated = true"),
    "no calibration": ([(CALIBRATED, "")], LEFT, RIGHT, r"does not say when its geometry was measured"),
    "calibrated in the future": ([(str(TODAY), days(2))], LEFT, RIGHT, "after today"),
    "calibrated too long ago": ([(str(TODAY), days(-181))], LEFT, RIGHT, "valid until"),
    "calibrated too long ago, by the file": (
        [(CALIBRATED, f"[calibration]\ndate = {days(-8)}\nvalid_days = 7\n")], LEFT, RIGHT, "valid until",
    ),
    "badly calibrated": ([("rms_mm = 1.2", "rms_mm = 3.1")], LEFT, RIGHT, "rms_mm"),
    "a typed date": ([("rms_mm = 1.2", "")], LEFT, RIGHT, "a date alone is no measurement"),
    "no box for the pads": ([("ee_lower = ", "# ee_lower = ")], LEFT, RIGHT, r"ee_lower and ee_upper under \[safety\]"),
    "whose box": ([], LEFT, RIGHT, r"its serial number, which .* under \[left\]"),
    "too coarsely calibrated": ([(CALIBRATED, CALIBRATED + "uncertainty_mm = 3.1\n")], LEFT, RIGHT, "uncertainty_mm"),
    "exchanged": ([], RIGHT, LEFT, r"\[left\] address"),
    "another left arm": ([], "192.0.2.9", RIGHT, r"\[left\] address"),
    "another right arm": ([], LEFT, "192.0.2.9", r"\[right\] address"),
    "by name": ([], "left.lab", RIGHT, r"\[left\] address"),
    "one of two is simulated": ([], LEFT, "127.0.0.12", "two real arms"),
    "the other of two is simulated": ([], "127.0.0.11", RIGHT, "two real arms"),
    "other real arms than the simulated ones": ([("simulated = false", "simulated = true")], "::2", RIGHT, "simulated"),
}  # fmt: skip


@pytest.mark.parametrize("changes, left, right, word", WRONG.values(), ids=WRONG)  # noqa: PT006
def test_a_wrong_set_up_is_refused_before_anything_is_connected_to(tmp_path, changes, left, right, word):
    path = cell_file(tmp_path, *changes)
    with pytest.raises(TrialError, match=word) as refused:
        open_cell(f"fci:{left},{right}", "rice_box", 0.0, 0, load_description(path)[0], cell_file=path)
    assert "\n" not in str(refused.value)


def test_a_file_from_before_its_calibration_is_refused(tmp_path):
    path = cell_file(tmp_path)
    os.utime(path, (0, time.time() - 2 * 86400))
    with pytest.raises(TrialError, match="take the measured numbers over"):
        open_cell(f"fci:{LEFT},{RIGHT}", "rice_box", 0.0, 0, load_description(path)[0], cell_file=path)


@pytest.mark.parametrize(
    "command",
    [
        ("teach", "out.mcap", "--cell"), ("identify-friction", "out.toml", "--cell"), ("up", "--left", LEFT, "--right"),
        ("robot", "--left", LEFT, "--right"),
    ],
)  # fmt: skip
def test_every_command_refuses_real_arms_on_the_simulated_cells_geometry(tmp_path, command_line, command):
    last = f"fci:{LEFT},{RIGHT}" if command[-1] == "--cell" else RIGHT
    done = command_line(*command, last, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "--cell-file" in done.stderr


def test_arms_that_a_person_leads_may_be_measured_for_the_first_time(tmp_path):
    path = cell_file(tmp_path, (CALIBRATED, ""), (LEFT, "127.0.99.97"), (RIGHT, "127.0.99.98"))
    description, kind = load_description(path)[0], "fci:127.0.99.97,127.0.99.98"
    with pytest.raises(TrialError, match="does not say when"):
        open_cell(kind, "", 0.0, 0, description, cell_file=path)
    with pytest.raises(HardwareError, match="does not answer"):
        open_cell(kind, "", 0.0, 0, description, cell_file=path, led=True)


def test_the_right_set_up_gets_as_far_as_the_arms(tmp_path):
    path = cell_file(tmp_path, (LEFT, "127.0.99.97"), (RIGHT, "127.0.99.98"))
    with pytest.raises(HardwareError, match="does not answer"):
        open_cell("fci:127.0.99.97,127.0.99.98", "rice_box", 0.0, 0, load_description(path)[0], cell_file=path)


# the person at the terminal


@pytest.fixture
def real(served_arms: ServedArms, tmp_path: Path) -> tuple[Path, str]:
    """The file and the kind of a cell that does not say that it is simulated."""
    places = ((LEFT, served_arms.left), (RIGHT, served_arms.right), ("127.0.0.1:1341", served_arms.tracker))
    return cell_file(tmp_path, *places), served_arms.cell


def at_a_terminal(command: list[str], until: Callable[[str], bool], name: str = "grab") -> tuple[int, str]:
    """Run a command at a terminal of its own: confirm by name, hold the space bar until then; status and output."""
    terminal = Terminal()
    ends = terminal.theirs
    process = subprocess.Popen(command, stdin=ends, stdout=ends, stderr=ends)
    terminal.hold(name, until)
    return process.wait(), terminal.said


@pytest.mark.alone
def test_they_move_while_the_space_bar_is_held_and_stop_when_it_is_let_go(real, tmp_path):
    path, kind = real

    def command(log: str) -> list[str]:
        return [*COMMAND, "teach", str(tmp_path / log), "--cell", kind, "--cell-file", str(path)]

    refused = subprocess.run(command("a.mcap"), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "space bar" in refused.stderr
    status, said = at_a_terminal(command("b.mcap"), lambda _: False, name="another")
    assert status == 2
    assert "not confirmed" in said
    assert not list(tmp_path.glob("*.mcap"))
    log = tmp_path / "c.mcap"
    status, said = at_a_terminal(command("c.mcap"), lambda _: log.exists() and log.stat().st_size > 500_000)
    assert status == 1, said  # before the demonstration's end
    assert "the operator" in said


@pytest.mark.alone
def test_they_stop_when_the_terminal_is_closed(real, tmp_path):
    path, kind = real
    log, terminal = tmp_path / "a.mcap", Terminal()
    ends = terminal.theirs
    command = [*COMMAND, "teach", str(log), "--cell", kind, "--cell-file", str(path)]
    process = subprocess.Popen(command, stdin=ends, stdout=ends, stderr=ends)
    terminal.hold(until=lambda _: log.exists() and log.stat().st_size > 500_000, hang_up=True)
    process.send_signal(signal.SIGHUP)  # as the kernel does to who has it as its terminal
    assert process.wait() == 1
    found = read_log(log)
    assert found.complete
    assert found.metadata["result"]["success"] == "false"
    assert found.topic("/left/control")["mode"][-1] == Mode.STOPPING


@pytest.mark.long
def test_a_campaign_on_them_is_watched_pauses_at_p_and_stops_at_any_other_key(real, tmp_path):
    """Without a person at a terminal it does not begin; with one, the arms move by themselves."""
    path, kind = real
    out = tmp_path / "out"
    command = [*COMMAND, "campaign", str(two_controllers(tmp_path / "p.toml", 20.0))]
    command += ["--out", str(out), "--cell", kind, "--cell-file", str(path), "--workers", "1"]
    refused = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert not out.exists()
    terminal = Terminal()
    ends = terminal.theirs
    process = subprocess.Popen(command, stdin=ends, stdout=ends, stderr=ends)
    terminal.watch((
        (lambda said: "any key stops them, p pauses" in said, "p"),
        (lambda said: "paused: press p to go on" in said, "p"),
        (lambda said: any((out / "logs").glob("*")), "x"),
    ))  # fmt: skip
    assert process.wait() == 2, terminal.said
    assert "was aborted, and is run again: stop requested by the operator" in terminal.said


def test_a_watched_campaign_stops_after_a_suspension(monkeypatch):
    """Nobody need be there any more when the machine, or the process, goes on."""
    stop, done, times = Interrupt(), threading.Event(), iter((0.0, 0.1, 0.2, 3600.0))
    monkeypatch.setattr("rtstack.cli.hold_to_run.since_boot_s", lambda: next(times))
    theirs, ours = os.pipe()
    keys = threading.Thread(  # it takes a real-time schedule
        target=HoldToRun._watch_keys, args=(object.__new__(HoldToRun), theirs, stop, done.set, done)
    )
    keys.start()
    keys.join()
    assert stop.stop_requested
    assert not done.is_set()  # it was no pause
    for descriptor in (theirs, ours):
        os.close(descriptor)


@pytest.mark.alone
@pytest.mark.long
def test_check_holds_them_while_the_space_bar_is_held(real):
    path, kind = real
    left, right = kind.removeprefix("fci:").split(",")
    command = [*COMMAND, "check", "--left", left, "--right", right]
    command += ["--cell-file", str(path)]
    refused = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "fail  cell for these arms" in refused.stdout
    assert "space bar" in refused.stdout
    looks = iter(range(75))  # 1.5 s of a held key
    status, said = at_a_terminal(command, lambda said: "Hold the space bar" in said and next(looks, None) is None)
    assert status == 1
    assert "the hold was ended before its time" in said
