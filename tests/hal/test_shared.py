"""Shared memory and temporary folders are one user's alone, are there as a whole, and outlive no process."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from hal.base import shared
from hal.base.configuration import ConfigurationError
from hal.base.shared import (
    Block,
    held,
    left_behind,
    private_folder,
    refuse_foreign,
    remove_left,
    user_folder,
    user_name,
)

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="becomes other users")
HOLDER = """
import sys, tempfile
from contextlib import ExitStack
from hal.base.shared import Block, private_folder
tempfile.tempdir = sys.argv[1]
with ExitStack() as stack:
    block = Block.create(sys.argv[2], 100)
    folder = stack.enter_context(private_folder("test"))
    (folder / "robot.sock").touch()
    print(folder, flush=True)
    input()
"""


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Give folders in the place of those that all users share."""
    memory, temporary = tmp_path / "memory", tmp_path / "temporary"
    memory.mkdir()
    temporary.mkdir()
    monkeypatch.setattr(shared, "MEMORY", memory)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    return memory, temporary


def test_what_a_killed_process_leaves_goes_and_what_a_living_one_has_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names = [f"rtstack-test-{os.getpid()}-{k}" for k in range(2)]
    holders = [
        subprocess.Popen([sys.executable, "-c", HOLDER, tmp_path, name], stdin=-1, stdout=-1, text=True)
        for name in names
    ]
    folders = [Path(each.stdout.readline().strip()) for each in holders]  # type: ignore[union-attr]
    (tmp_path / "rtstack-of-a-person").mkdir()  # not ours, whatever its name
    attached = Block.attach(names[1])
    for each in holders:
        each.kill()
        each.communicate()
    with held(folders[1]):
        assert {Path("/dev/shm", names[0]), folders[0]} <= left_behind().keys()
        assert not {Path("/dev/shm", names[1]), folders[1]} & left_behind().keys()
        remove_left()
        assert [Path("/dev/shm", name).exists() for name in names] == [False, True]
        assert sorted(tmp_path.iterdir()) == sorted([folders[1], tmp_path / "rtstack-of-a-person"])
    del attached
    remove_left()
    assert not Path("/dev/shm", names[1]).exists()
    assert [each.name for each in tmp_path.iterdir()] == ["rtstack-of-a-person"]


OLDER = """
import mmap, os
name = f"rtstack-{os.getpid()}-0123abcd"
with open(f"/dev/shm/{name}", "w+b") as file:
    file.truncate(64)
    memory = mmap.mmap(file.fileno(), 64)
print(name, flush=True)
input()
"""


def test_a_block_without_a_lock_stays_while_its_process_maps_it():
    """As of a stack of an older version, which runs on while this one starts."""
    with subprocess.Popen([sys.executable, "-c", OLDER], stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout is not None
        path = Path("/dev/shm", process.stdout.readline().strip())
        assert path not in left_behind()
        remove_left()
        assert path.exists()
        process.kill()
    assert path in left_behind()
    remove_left()
    assert not path.exists()


def test_a_block_is_there_as_a_whole_or_not_at_all(places, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    block = Block.create("rtstack-a", 4096)
    assert (len(block.memory), (places[0] / "rtstack-a").stat().st_blocks * 512) == (4096, 4096)
    with pytest.raises(FileExistsError):
        Block.create("rtstack-a", 4096)
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        Block.create("rtstack-b", 4096)
    assert [path.name for path in places[0].iterdir()] == ["rtstack-a"]
    block.close()
    block.close()
    assert not list(places[0].iterdir())


def test_nothing_is_attached_that_another_user_may_write(places):
    block = Block.create("rtstack-a", 64)
    path = places[0] / "rtstack-a"
    (places[0] / "link").symlink_to(path)
    with pytest.raises(OSError, match="symbolic links"):
        Block.attach("link")
    os.mkfifo(places[0] / "pipe")
    with pytest.raises(PermissionError):
        Block.attach("pipe")
    path.chmod(0o666)
    with pytest.raises(PermissionError):
        Block.attach("rtstack-a")
    block.close()


@needs_root
def test_nothing_is_attached_that_another_user_owns(places):
    block = Block.create("rtstack-a", 64)
    os.chown(places[0] / "rtstack-a", 4243, 4243)
    with pytest.raises(PermissionError):
        Block.attach("rtstack-a")
    assert left_behind() == {}
    remove_left()
    assert (places[0] / "rtstack-a").exists()
    block.close()


@pytest.mark.parametrize("kind", ["open", "link to an open one", "in an open one"])
def test_a_folder_that_others_may_change_is_refused(tmp_path, kind):
    tmp_path.chmod(0o700)
    folder = tmp_path / "folder"
    folder.mkdir(0o700)
    refuse_foreign(folder)
    folder.chmod(0o770)
    asked = folder
    if kind == "in an open one":
        asked = folder / "inner"
        asked.mkdir(0o700)
    elif kind != "open":
        asked = tmp_path / "link"
        asked.symlink_to(folder)
    with pytest.raises(PermissionError, match="other users may write it"):
        refuse_foreign(asked)
    folder.chmod(0o1777)
    if kind == "in an open one":  # as in /tmp
        refuse_foreign(asked)


@needs_root
@pytest.mark.parametrize("whose", ["folder", "folder above", "link"])
def test_a_folder_of_another_user_is_refused(tmp_path, whose):
    above, link = tmp_path / "above", tmp_path / "link"
    folder = above / "folder"
    folder.mkdir(parents=True)
    link.symlink_to(folder)
    os.chown({"folder": folder, "folder above": above, "link": link}[whose], 4243, 4243, follow_symlinks=False)
    with pytest.raises(PermissionError, match="it belongs to uid 4243"):
        refuse_foreign(link if whose == "link" else folder)


def test_a_private_folder_is_not_made_where_others_may_replace_it(places):
    places[1].chmod(0o777)
    with pytest.raises(PermissionError, match="other users may write it"), private_folder("test"):
        pass
    places[1].chmod(0o1777)
    with private_folder("test") as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
    assert not list(places[1].iterdir())


def test_a_user_without_a_name_or_home_is_one_line(monkeypatch, tmp_path):
    assert user_name(4_000_000_000) == "uid 4000000000"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert user_folder("XDG_CONFIG_HOME", ".config") == tmp_path / "rtstack"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr(Path, "home", lambda: Path("~nobody-at-all").expanduser())
    with pytest.raises(ConfigurationError, match="has no home folder: set HOME, or XDG_CONFIG_HOME"):
        user_folder("XDG_CONFIG_HOME", ".config")
