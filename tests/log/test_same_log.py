"""The same command and seed give the same log, whatever else the machine does: every message but the host's clock."""

import subprocess
from pathlib import Path

import pytest

from tests.support.log.same_log import RTSTACK, busy_loops, differences, messages


def trial(reference: Path, log: Path, cell: str) -> None:
    ended = subprocess.run(
        [RTSTACK, "trial", "--reference", reference, "--cell", cell, "--displacement-mm", "-30", "--log", log],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.alone
@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("kind", ["direct", "lockstep"])
def test_the_same_command_gives_the_same_messages_quiet_and_loaded(kind: str, demonstration, tmp_path: Path) -> None:
    quiet, loaded = tmp_path / "quiet.mcap", tmp_path / "loaded.mcap"
    trial(demonstration.path, quiet, kind)
    with busy_loops(1):
        trial(demonstration.path, loaded, kind)
    assert differences(quiet, loaded) == []
    times = [t_ns for _, t_ns, _ in messages(quiet)]
    assert times[0] == 0
    assert times == sorted(times)
