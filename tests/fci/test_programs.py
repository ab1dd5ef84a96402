"""Unmodified client programs, each in its own process, as their authors' examples go."""

import subprocess
import sys
from pathlib import Path

import pytest
from fci_server import Served


@pytest.mark.parametrize("program", ["aiofranka", "franka_rs", "franky_motions", "pylibfranka"])
def test_a_program_runs_through(lockstep: Served, program: str) -> None:
    path = Path(__file__).with_name(f"{program}_program.py")
    finished = subprocess.run(
        [sys.executable, str(path), lockstep.left], capture_output=True, text=True, timeout=120, check=False
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
