"""A file is there whole or as it was, and one process at a time changes it."""

import os
import stat
import subprocess
import sys
import threading

import pytest

from hal.base.files import locked, replacing, write_whole


def test_a_file_is_replaced_whole_or_stays_as_it_was(tmp_path):
    path = tmp_path / "settings.json"
    write_whole(path, "é", durable=True, mode=0o600)
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == ("é".encode(), 0o600)
    with pytest.raises(KeyError), replacing(path) as new:
        new.write_text(path.read_text() + {}["missing"])
    assert path.read_text() == "é"
    with replacing(path) as new:
        new.write_bytes(b"whole")
    assert path.read_text() == "whole"
    path.unlink()
    path.mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        write_whole(path, "")
    assert list(tmp_path.iterdir()) == [path]


def test_a_reader_sees_one_of_the_states_that_were_written(tmp_path):
    path, over = tmp_path / "counts", threading.Event()
    write_whole(path, "0" * 10_000)

    def write() -> None:
        for n in range(300):
            write_whole(path, str(n % 10) * 10_000)
        over.set()

    writer = threading.Thread(target=write)
    writer.start()
    while not over.is_set():
        assert len(set(path.read_text())) == 1
    writer.join()


def test_the_disk_has_a_file_before_its_name_and_then_the_name(tmp_path, monkeypatch):
    done = []
    names = {path.stat().st_ino: name for path, name in ((tmp_path, "folder"),)}
    monkeypatch.setattr(os, "fsync", lambda file: done.append(names.get(os.fstat(file).st_ino, "file")))
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("name"), replace(*paths)))
    write_whole(tmp_path / "a", "1")
    assert done == ["file", "name", "folder"]
    done.clear()
    write_whole(tmp_path / "a", "2", durable=False)
    assert done == ["name"]


HOLD = """
import sys, pathlib
from hal.base.files import locked
with locked(pathlib.Path(sys.argv[1])):
    print(1, flush=True)
    input()
"""


@pytest.mark.parametrize("folder", [False, True])
def test_one_process_at_a_time_holds_a_lock_which_ends_with_it(tmp_path, folder):
    path = tmp_path if folder else tmp_path / "lock"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "1\n"
    for shared in (False, True):
        with pytest.raises(BlockingIOError), locked(path, shared, wait=False):
            pass
    holder.kill()
    holder.communicate()
    with locked(path, shared=True, wait=False), locked(path, shared=True, wait=False):
        pass
    with locked(path):
        pass
