"""What the program `compare` says where another author's robot cannot be had."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.foreign_robot import VERSIONS

ROOT = Path(__file__).parents[2]


@pytest.mark.long
def test_a_peer_that_pip_does_not_find_is_one_line(tmp_path: Path) -> None:
    """pip's index is a port of this machine at which nobody listens; the environments are a new folder's."""
    program = (
        "import sys, pathlib, tests.support.foreign_robot as peers, tests.programs.compare as c;"
        "peers.ENVIRONMENTS = pathlib.Path(sys.argv.pop()); sys.exit(c.main())"
    )
    told = os.environ | {"PIP_INDEX_URL": "http://127.0.0.1:9/", "PIP_RETRIES": "0"}
    done = subprocess.run(
        [sys.executable, "-c", program, "--out", str(tmp_path / "compare.md"), str(tmp_path / "environments")],
        cwd=ROOT, env=told, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"compare: franka-sim {VERSIONS['franka-sim']} cannot be installed by pip: ")
    assert done.stdout == ""
    assert not (tmp_path / "compare.md").exists()
