"""The catalogue of a directory: what the files say, however often and from whatever state of the cache."""

import contextlib
import json
import os
import sqlite3
import time
from pathlib import Path

import pytest

from rtstack.log.errors import LogError
from rtstack.log_folder.catalogue import CACHE, Catalogue, LogCondition
from tests.support.log.samples import RESULT, TRIAL, WrittenLog


@pytest.fixture
def directory(tmp_path: Path, written: WrittenLog) -> Path:
    content = written.path.read_bytes()
    now = time.time_ns()
    for age, (name, data) in enumerate(
        (("whole.mcap", content), ("cut.mcap", content[: len(content) // 2]), ("notes.mcap", b"hello"))
    ):
        path = tmp_path / name
        path.write_bytes(data)
        os.utime(path, ns=(now, now - age * 10**9))
    (tmp_path / "other.txt").write_text("not listed")
    return tmp_path


def test_every_log_is_listed_with_its_trial_and_result(directory: Path) -> None:
    whole, cut, notes = Catalogue(directory).entries()
    assert (whole.path.name, whole.condition) == ("whole.mcap", LogCondition.COMPLETE)
    assert (whole.kind, whole.trial, whole.result) == ("trial", TRIAL, RESULT)
    assert whole.size_bytes == (directory / "whole.mcap").stat().st_size
    assert (cut.condition, cut.trial, cut.result) == (LogCondition.TRUNCATED, TRIAL, None)
    assert (notes.condition, notes.trial, notes.result) == (LogCondition.FOREIGN, None, None)


def test_ids_say_nothing_of_the_path_and_stay(directory: Path) -> None:
    before = Catalogue(directory).entries()
    with open(directory / "cut.mcap", "ab") as file:
        file.write(b"\0" * 100)  # a log that is being written
    after = Catalogue(directory).entries()
    assert {e.id for e in before} == {e.id for e in after}
    assert len({e.id for e in before}) == 3
    for entry in after:
        assert entry.path.stem not in entry.id
        assert Catalogue(directory).entry(entry.id) == entry
    with pytest.raises(LogError, match="no log"):
        Catalogue(directory).entry("../whole.mcap")


def test_a_second_look_reads_no_file(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = Catalogue(directory).entries()

    def fail(path: Path) -> None:
        raise AssertionError(f"{path} was read again")

    monkeypatch.setattr("rtstack.log_folder.catalogue._read", fail)
    assert Catalogue(directory).entries() == before


def test_changes_are_seen(directory: Path, written: WrittenLog) -> None:
    catalogue = Catalogue(directory)
    catalogue.entries()
    (directory / "cut.mcap").unlink()
    (directory / "notes.mcap").write_bytes(written.path.read_bytes())
    entries = {entry.path.name: entry.condition for entry in catalogue.entries()}
    assert entries == {"whole.mcap": LogCondition.COMPLETE, "notes.mcap": LogCondition.COMPLETE}


@pytest.mark.parametrize("damage", [b"", b"no database at all" * 100])
def test_the_cache_can_be_lost_or_broken(directory: Path, damage: bytes) -> None:
    before = Catalogue(directory).entries()
    (directory / CACHE).write_bytes(damage)
    assert Catalogue(directory).entries() == before
    (directory / CACHE).unlink()
    assert Catalogue(directory).entries() == before
    assert (directory / CACHE).stat().st_size > 0


def test_a_cache_that_somebody_else_holds_is_done_without(directory: Path) -> None:
    before = Catalogue(directory).entries()
    holder = sqlite3.connect(directory / CACHE)
    with contextlib.closing(holder):
        holder.execute("BEGIN EXCLUSIVE")
        assert Catalogue(directory, patience_s=0.01).entries() == before


def test_metadata_of_a_trial_is_json_ready(directory: Path) -> None:
    entry = Catalogue(directory).entries()[0]
    assert entry.trial is not None
    assert json.loads(entry.trial["specification"]) == {"controller": "proposed"}


def test_a_missing_directory_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot read"):
        Catalogue(tmp_path / "none").entries()
