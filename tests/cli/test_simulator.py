"""`rtstack sim` as its users meet it: what it prints, what it refuses in one line, and how it ends."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from hal.tracker_link import DATAGRAM
from hal.wire import PORT
from tests.support.one_arm import one_arm_file

COMMAND = Path(sys.executable).with_name("rtstack")
PREFIX = f"127.{100 + os.getpid() % 100}.{1 + os.getpid() // 100 % 250}"
LEFT, RIGHT = f"{PREFIX}.201", f"{PREFIX}.202"


def command(*arguments: object) -> list[str]:
    return [str(COMMAND), "sim", "--left", LEFT, "--right", RIGHT, *map(str, arguments)]


@pytest.fixture
def refusal(command_line: Callable[..., subprocess.CompletedProcess[str]]) -> Callable[..., str]:
    """Give it what it must refuse; returns the one line that it says."""

    def refused(*arguments: object) -> str:
        done = command_line(*command(*arguments)[1:])
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
        return done.stderr

    return refused


@contextlib.contextmanager
def serving(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], IO[str]]]:
    """Serve in a process of its own; give it, and what it says."""
    with subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scene", "attic"], ["attic", "there is grab"]),
        (["--scene", "../scenes/grab"], ["there is grab"]),
        (["--faults", "missing.toml"], ["missing.toml", "cannot be read"]),
        (["--left", "8.8.8.8"], ["8.8.8.8", "addresses of this host"]),
        (["--left", RIGHT], ["two arms have two addresses"]),
        (["--tracker", "nowhere"], ["--tracker", "HOST:PORT", "nowhere"]),
        (["--tracker", "127.0.0.1:99999"], ["HOST:PORT"]),
        (["--phase-us", "1000"], ["the phase is 0 to below 1000 us"]),
        (["--drift-ppm", "nan"], ["drift"]),
        (["--lockstep", "--drift-ppm", "50"], ["in lockstep there is no clock"]),
        (["--object", "anvil"], ["anvil", "rice_box", "none: an empty cell"]),
        (["--object", "none", "--displacement-mm", "5"], ["empty cell", "displaced"]),
        (["--object", "none", "--yaw-deg", "5"], ["empty cell", "displaced"]),
        (["--displacement-x-mm", "101"], ["along x", "-100 to +100 mm"]),
        (["--yaw-deg", "-46"], ["-46 deg", "-45 to +45 deg"]),
        (["--object", "anvil"], ["[objects.anvil]", "--cell-file"]),
        (["--cell-file", "missing.toml"], ["missing.toml"]),
        (["--only", "middle"], ["--only", "left", "right"]),
        (["--only", "left", "--phase-us", "5"], ["--phase-us and --drift-ppm compare two arms", "left one"]),
        (["--only", "right", "--drift-ppm", "5"], ["--phase-us and --drift-ppm compare two arms", "right one"]),
        (["--only", "left", "--displacement-mm", "-300"], ["-250 to +190 mm", "table edge and pad)"]),
        (["--priority", "100"], ["--priority"]),
        (["--seed", "-1"], ["--seed"]),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_served(
    refusal: Callable[..., str], arguments: list[str], words: list[str]
) -> None:
    said = refusal(*arguments)
    for word in words:
        assert word in said


def test_bad_input_on_the_command_line(tmp_path: Path) -> None:
    done = subprocess.run(command("--scene", "attic"), capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
    assert "attic" in done.stderr


def test_a_script_of_faults_that_is_wrong_is_named_with_its_line(refusal: Callable[..., str], tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text('[[fault]]\nkind = "push"\narm = "left"\nat_s = 1.0\nforce = [1, 2, 3]\n', encoding="utf-8")
    assert "script.toml:5: fault 1 (push): unknown key 'force'" in refusal("--faults", path)


def test_what_names_an_arm_that_is_not_there(refusal: Callable[..., str], tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text('[[fault]]\nkind = "user_stop"\narm = "left"\nat_s = 1.0\n', encoding="utf-8")
    said = refusal("--only", "right", "--faults", path)
    assert "script.toml:3: fault 1 (user_stop): arm cannot be 'left'; say right" in said
    file = one_arm_file(tmp_path, "right")
    assert "the cell has no left arm, only right" in refusal("--only", "left", "--cell-file", file)
    assert "compare two arms" in refusal("--cell-file", file, "--drift-ppm", "5")


def test_an_address_in_use(refusal: Callable[..., str]) -> None:
    with socket.create_server((LEFT, PORT)):
        said = refusal()
    assert "in use" in said
    assert LEFT in said
    assert "--left and --right" in said
    with socket.create_server((RIGHT, PORT)):
        said = refusal("--only", "right")
    assert "with --right\n" in said
    assert "left" not in said


def test_it_says_what_comes_next_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    """With a script of faults and a listener for the object's poses; the last lines tell how the pace was kept."""
    path = tmp_path / "script.toml"
    path.write_text('[[fault]]\nkind = "user_stop"\narm = "both"\nat_s = 0\n', encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind((PREFIX + ".203", 0))
        listener.settimeout(60.0)
        tracker = "{}:{}".format(*listener.getsockname())
        placed = ("--object", "parcel", "--displacement-mm", "10")
        with serving("--faults", path, "--tracker", tracker, *placed) as (process, said):
            assert said.readline().startswith(f"serving {LEFT} and {RIGHT}, 1 kHz")
            trial = f"rtstack trial --reference REC.mcap --cell fci:{LEFT},{RIGHT} --object parcel --displacement-mm=10"
            assert said.readline() == f"run a trial against it: {trial}\n"
            assert len(listener.recv(4096)) == DATAGRAM.itemsize
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "stalls of this host" in out
    assert err == ""


def test_an_empty_cell_is_served_for_a_playback() -> None:
    """Nobody sees an object, from the first state on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind((PREFIX + ".204", 0))
        listener.settimeout(60.0)
        tracker = "{}:{}".format(*listener.getsockname())
        with serving("--lockstep", "--tracker", tracker, "--object", "none") as (process, said):
            assert said.readline().startswith(f"serving {LEFT} and {RIGHT}, lockstep")
            assert said.readline().endswith(f"rtstack play LOG.mcap --cell fci:{LEFT},{RIGHT}\n")
            assert not np.frombuffer(listener.recv(4096), DATAGRAM)["seen"][0]
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=60) == ("", "")


@pytest.mark.parametrize(
    ("side", "address", "cell"), [("left", LEFT, LEFT), ("right", RIGHT, f",{RIGHT}")], ids=["left", "right"]
)
def test_one_arm_is_served_and_the_other_one_is_not_mentioned(side: str, address: str, cell: str) -> None:
    with serving("--lockstep", "--only", side, "--tracker", f"{PREFIX}.205:1341") as (process, said):
        assert said.readline() == f"serving {address}, lockstep, profile ideal\n"
        play = f"rtstack play LOG.mcap --cell fci:{cell} --cell-file CELL.toml"
        assert said.readline() == f"one arm alone grabs nothing: play a log on it: {play}\n"
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("", "")


def test_ctrl_c_before_it_serves() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", "import os, signal\nfrom rtstack.cli import simulator\n"
         "import threading\nthreading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
         "simulator.sim(left='nowhere.invalid')"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
