"""The plug-in for other people's tests: clients of every kind find arms, each test its own; what lacks is one line."""

import contextlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pylibfranka as franka
import pytest

from hal.errors import HardwareError
from rtstack.cells import open_cell
from rtstack.testing import ServedArms, serve_arms
from tests.support.fci.client import program_path

# the tests of a package of its own, as its author writes them; -W error
CONFTEST = 'from rtstack.testing import ServedArms, serve_arms\n\npytest_plugins = ["rtstack.testing"]\n'
TESTS = """
import os

import pylibfranka


def reads(address):
    return pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore).read_once().robot_mode


def test_lockstep(served_arms):
    assert str(reads(served_arms.left)) == "RobotMode.Idle"
    print("PID", served_arms.pid)


def test_real_time(realtime_arms):
    assert str(reads(realtime_arms.right)) == "RobotMode.Idle"
    print("PID", realtime_arms.pid)
"""
# as if a package of the extra were not installed
LACKING = "import sys\nsys.modules['mujoco'] = None\nimport pytest\nsys.exit(pytest.main(sys.argv[1:]))"


def run_tests_of_another(folder: Path, *start: str) -> subprocess.CompletedProcess[str]:
    """Run the tests of a package outside of this repository."""
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "test_client.py").write_text(TESTS)
    command = [sys.executable, *start, "-p", "no:cacheprovider", "-W", "error", "-s", str(folder)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120.0)


@pytest.mark.long
def test_a_package_of_others_tests_its_client(tmp_path: Path) -> None:
    done = run_tests_of_another(tmp_path, "-m", "pytest")
    assert done.returncode == 0, done.stdout + done.stderr
    pids = [
        int(words[-1]) for line in done.stdout.splitlines() if len(words := line.partition("PID ")[::2]) and words[1]
    ]
    assert len(set(pids)) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_without_the_extra_a_test_fails_with_one_line(tmp_path: Path) -> None:
    done = run_tests_of_another(tmp_path, "-c", LACKING)
    assert done.returncode == 1
    assert done.stdout.count("mujoco is not installed: pip install 'rtstack[sim]'") >= 2
    assert "Traceback" not in done.stdout + done.stderr


def test_a_server_that_does_not_start_says_why() -> None:
    with pytest.raises(HardwareError, match=r"the simulated robot did not start: .*anvil"), serve_arms("anvil"):
        pytest.fail("it started")


@pytest.mark.long
def test_the_client_in_rust_controls(served_arms: ServedArms) -> None:
    command = [sys.executable, str(program_path("franka_rs")), served_arms.left]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_cell_is_opened_and_its_object_is_seen(served_arms: ServedArms) -> None:
    cell = open_cell(served_arms.cell, "rice_box", 0.0, 0, served_arms.description)
    with contextlib.closing(cell):
        for arm in cell.arms:
            assert np.abs(arm.read().q).max() > 1.0
        assert cell.tracker.latest().record["seen"][0] == 1


def test_options_reach_the_server_of_one_arm_which_ends_with_the_block_also_after_an_error() -> None:
    pids = []
    with pytest.raises(ZeroDivisionError), serve_arms("", sides=("right",), options=("--seed", "7")) as served:  # noqa: PT012
        assert (served.left, served.cell) == ("", f"fci:,{served.right}")
        words = Path(f"/proc/{served.pid}/cmdline").read_text().split("\0")
        assert words[-3:-1] == ["--seed", "7"]
        assert franka.Robot(served.right, franka.RealtimeConfig.kIgnore).read_once().time.to_sec() >= 0.0
        pids.append(served.pid)
        raise ZeroDivisionError
    assert not Path(f"/proc/{pids[0]}").exists()
