"""Unmodified client programs, each in its own process, as their authors' examples go."""

import subprocess
import sys

import pytest

from tests.support.fci.client import program_path
from tests.support.fci.server import Served


@pytest.mark.parametrize(
    "program", [pytest.param("aiofranka", marks=pytest.mark.long), "franka_rs", "franky_motions", "pylibfranka"]
)
def test_a_program_runs_through(lockstep: Served, program: str) -> None:
    path = program_path(program)
    finished = subprocess.run(
        [sys.executable, str(path), lockstep.left], capture_output=True, text=True, timeout=120, check=False
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
