"""`rtstack desk` as its users meet it, against both boxes of the simulated robot."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hal.fci.arm import FciArm
from sim_robot.desk.server import PASSWORD, USER
from tests.support.desk import desk_address, desk_cell_file

COMMAND = Path(sys.executable).with_name("rtstack")
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def rtstack(tmp_path) -> Run:
    """Run `rtstack desk` with a configuration folder of the test's own; sign_in: with user and password."""

    def run(*words: str, sign_in: bool = True) -> subprocess.CompletedProcess[str]:
        signed = {"RTSTACK_DESK_USER": USER, "RTSTACK_DESK_PASSWORD": PASSWORD} if sign_in else {}
        return subprocess.run(
            [str(COMMAND), "desk", *words], env={**os.environ, "XDG_CONFIG_HOME": str(tmp_path), **signed},
            capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60,
        )  # fmt: skip

    return run


@pytest.fixture
def cell_file(boxes, tmp_path) -> str:
    return str(desk_cell_file(tmp_path / "cell.toml", map(desk_address, (boxes.left, boxes.right))))


def test_both_boxes_are_started_looked_at_and_stopped(rtstack, boxes, cell_file):
    first = rtstack("status", "--cell-file", cell_file, sign_in=False)
    assert first.returncode == 0
    assert first.stdout.count("not ready: brakes locked, FCI Inactive, mode Execution, control free") == 2
    assert first.stderr.count("first use of Desk") == 2
    started = rtstack("start", "--cell-file", cell_file)
    assert (started.returncode, started.stderr) == (0, "")
    assert sorted(started.stdout.splitlines()) == [
        f"{side} box: {step}"
        for side in ("left", "right")
        for step in ("FCI active", "brakes unlocked", "control taken")
    ]
    said = json.loads(rtstack("status", "--cell-file", cell_file, "--json").stdout)
    assert all(said[side]["ready"] and said[side]["control"] == "rtstack" for side in ("left", "right"))
    for address in (boxes.left, boxes.right):
        arm = FciArm(address)
        assert arm.read().robot_mode.name == "IDLE"
        arm.close()
    stopped = rtstack("stop", "--cell-file", cell_file)
    assert (stopped.returncode, stopped.stdout.count("control given back")) == (0, 2)


@pytest.mark.parametrize(
    ("words", "sign_in", "reason"),
    [
        (("status",), False, "where is Desk of the boxes?"),
        (("status", "--left", "127.0.0.9:1"), False, "the left box at 127.0.0.9:1 does not answer"),
        (("status", "--left", "127.0.0.9:9", "--right", "127.0.0.9:9"), False, "two boxes have two addresses"),
        (("status", "--left", "127.0.0.9:9", "--right", "127.0.0.8:9"), False, "does not answer: Connection refused"),
        (("status", "--left", "127.0.0.9:port", "--right", "127.0.0.8:9"), False, "expected HOST or HOST:PORT"),
        (("start", "LEFT", "RIGHT"), False, "set RTSTACK_DESK_USER and RTSTACK_DESK_PASSWORD"),
    ],
)
def test_what_cannot_be_done_is_one_line(rtstack, boxes, words, sign_in, reason):
    known = {"LEFT": f"--left={desk_address(boxes.left)}", "RIGHT": f"--right={desk_address(boxes.right)}"}
    done = rtstack(*(known.get(word, word) for word in words), sign_in=sign_in)
    assert done.returncode == 2
    assert reason in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
