"""A trial's log names the reference that it followed, and does not carry it twice."""

import shutil
from pathlib import Path

import pytest

from rtstack.log.reader import read_log
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import Followed, followed_file


def trial(command_line, reference: Path, log: Path, *more: str) -> None:
    ended = command_line("trial", "--reference", reference, "--log", log, "--json", *more)
    assert ended.returncode == 0, ended.stderr


def test_a_log_names_its_reference_and_finds_it_again(demonstration, tmp_path: Path, command_line) -> None:
    reference = tmp_path / "ref.mcap"
    shutil.copy(demonstration.path, reference)
    path = tmp_path / "trial.mcap"
    trial(command_line, reference, path)
    log = read_log(path)
    assert {attachment.name for attachment in log.attachments} == {"cell.toml", "fr3.urdf"}
    assert log.metadata["reference"] == Followed(reference).record()
    assert path.stat().st_size < 1.3 * reference.stat().st_size  # a trial's samples are as many as its reference's
    name = str(reference)
    digest, content = followed_file(log, name)
    assert content == reference.read_bytes()
    assert digest == log.metadata["reference"]["sha256"]

    folder = tmp_path / "elsewhere"
    folder.mkdir()
    moved = folder / "trial.mcap"
    shutil.move(path, moved)
    shutil.move(reference, folder / "ref.mcap")
    assert followed_file(read_log(moved), name)[0] == digest  # beside the log

    with open(folder / "ref.mcap", "ab") as file:
        file.write(b"more")
    with pytest.raises(TrialError, match=r"ref\.mcap is not the reference that it followed any more"):
        followed_file(read_log(moved), name)

    (folder / "ref.mcap").unlink()
    with pytest.raises(TrialError, match=r"its reference .*ref\.mcap is neither there nor attached: put it there"):
        followed_file(read_log(moved), name)
    assert command_line("review", moved).returncode == 0  # which needs no reference
    said = command_line("tune-monitor", *[moved] * 6, "--out", tmp_path / "box.toml")
    assert said.returncode == 2
    assert "is neither there nor attached" in said.stderr
    assert not (tmp_path / "box.toml").exists()


def test_a_log_takes_the_whole_reference_where_asked(demonstration, tmp_path: Path, command_line) -> None:
    reference, path = tmp_path / "ref.mcap", tmp_path / "trial.mcap"
    shutil.copy(demonstration.path, reference)
    trial(command_line, reference, path, "--whole-reference")
    reference.unlink()
    assert followed_file(read_log(path), "ref.mcap")[1] == demonstration.path.read_bytes()
