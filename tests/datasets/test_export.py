"""An export goes on where it ended, is never half there under its name, and says in one line what is wrong."""

import itertools
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import pytest

from rtstack.datasets.export import Format, export
from rtstack.datasets.hdf5 import Hdf5
from rtstack.datasets.lerobot import LeRobot
from rtstack.datasets.zarr import Zarr
from rtstack.log.errors import LogError
from rtstack.log_folder.remarks import EpisodeVerdict, Remarks, save_remarks
from tests.support.log.samples import WrittenLog
from tests.support.log.seen import write_seen_log

Logs = tuple[WrittenLog, WrittenLog]


class _InterruptedError(Exception):
    pass


def _interrupted(after: int) -> Callable[[float], None]:
    """Progress that ends the export after this many episodes, as Ctrl-C would."""
    counted = itertools.count(1)

    def show(fraction: float) -> None:
        if next(counted) == after:
            raise _InterruptedError

    return show


def test_an_interrupted_export_goes_on_and_gives_the_same(logs: Logs, tmp_path: Path) -> None:
    paths, out = [log.path for log in logs], tmp_path / "data.h5"
    with pytest.raises(_InterruptedError):
        export(paths, out, Hdf5(), _interrupted(after=1))
    assert not out.exists()
    (tmp_path / "data.h5.partial" / "unfinished").write_bytes(b"half an episode")
    done = export(paths, out, Hdf5())
    assert (done.episodes, done.present) == (2, 1)
    assert list(tmp_path.iterdir()) == [out]
    with h5py.File(out) as file:
        assert len(file) == 2


def test_an_export_that_was_joining_goes_on(logs: Logs, tmp_path: Path) -> None:
    paths, out = [log.path for log in logs], tmp_path / "data.h5"
    with pytest.raises(_InterruptedError):
        export(paths, out, Hdf5(), _interrupted(after=2))
    (tmp_path / "data.h5.partial" / "whole").write_bytes(b"half a data set")
    assert export(paths, out, Hdf5()).present == 2
    with h5py.File(out) as file:
        assert len(file) == 2


def test_a_log_that_changed_is_exported_again(logs: Logs, tmp_path: Path) -> None:
    copied, out = tmp_path / "copied.mcap", tmp_path / "data.h5"
    copied.write_bytes(logs[0].path.read_bytes())
    with pytest.raises(_InterruptedError):
        export([copied], out, Hdf5(), _interrupted(after=1))
    copied.write_bytes(logs[1].path.read_bytes())
    assert export([copied], out, Hdf5()).present == 0
    with h5py.File(out) as file:
        (recording,) = file.values()
        assert len(recording["SENSOR_MEASUREMENT/timing/datalog"]) == len(logs[1].columns["/timing"])


def test_what_is_wrong_is_said_before_anything_is_written(
    logs: Logs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut, taken = tmp_path / "cut.mcap", tmp_path / "taken.h5"
    whole = logs[0].path
    cut.write_bytes(whole.read_bytes()[:-1000])
    (tmp_path / "mine.h5.partial").mkdir()
    (tmp_path / "mine.h5.partial" / "thesis.tex").write_text("mine")
    taken.write_text("mine")
    for paths, out, words in (
        ([tmp_path / "none.mcap"], "data.h5", "none.mcap: cannot be read: No such file"),
        ([cut], "data.h5", "rtstack recover"),
        ([], "data.h5", "name the logs"),
        ([whole], "mine.h5", "not what an export has left"),
        ([whole], "taken.h5", "exists already"),
        ([whole], "none/data.h5", "the folder"),
    ):
        with pytest.raises(LogError, match=words):
            export(paths, tmp_path / out, Hdf5())
    monkeypatch.setattr(Hdf5, "needs", ("h5py_is_not_here",))
    with pytest.raises(LogError, match=r"h5py_is_not_here is not installed: pip install 'rtstack\[export\]'"):
        export([whole], tmp_path / "data.h5", Hdf5())
    names = ["cut.mcap", "mine.h5.partial", "taken.h5"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_the_same_log_under_another_name_is_one_episode(logs: Logs, tmp_path: Path) -> None:
    copied = tmp_path / "copied.mcap"
    copied.write_bytes(logs[0].path.read_bytes())
    done = export([logs[0].path, copied, logs[1].path, logs[1].path], tmp_path / "data.h5", Hdf5())
    assert [bool(each.why) for each in done.candidates] == [False, True, False, True]
    with h5py.File(tmp_path / "data.h5") as file:
        assert len(file) == done.episodes == 2


@pytest.mark.parametrize("form", [LeRobot(), Zarr()], ids=["lerobot", "zarr"])
def test_a_log_whose_frames_are_not_like_most_is_left_out(form: Format, logs: Logs, tmp_path: Path) -> None:
    write_seen_log(logs[0].path, tmp_path / "seen.mcap", count=3)
    done = export([tmp_path / "seen.mcap", *(log.path for log in logs)], tmp_path / "data", form)
    assert done.episodes == 2
    assert "it has /camera/front/image too; export it by itself" in done.candidates[0].why


def test_an_export_goes_on_where_a_verdict_has_changed(logs: Logs, tmp_path: Path) -> None:
    paths = []
    for log in logs:
        paths.append(tmp_path / log.path.name)
        paths[-1].write_bytes(log.path.read_bytes())
    with pytest.raises(_InterruptedError):
        export(paths, tmp_path / "data.h5", Hdf5(), _interrupted(after=2))
    save_remarks(paths[0], Remarks(verdict=EpisodeVerdict.KEPT))
    assert export(paths, tmp_path / "data.h5", Hdf5()).present == 1
    with h5py.File(tmp_path / "data.h5") as file:
        assert [each.attrs["episode_verdict"] for each in file.values()] == ["kept", "none"]


def test_a_log_that_is_damaged_inside_leaves_nothing(logs: Logs, tmp_path: Path) -> None:
    damaged = bytearray(logs[0].path.read_bytes())
    middle = len(damaged) // 2
    damaged[middle : middle + 64] = bytes(64)
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    with pytest.raises(LogError, match="damaged"):
        export([tmp_path / "damaged.mcap"], tmp_path / "data.h5", Hdf5())
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.mcap"]


@contextmanager
def _no_file_larger_than(size: int) -> Iterator[None]:
    """As a full disk, for this process: a write that goes beyond fails."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("form", [Hdf5(), LeRobot(), Zarr()], ids=["hdf5", "lerobot", "zarr"])
def test_a_disk_that_takes_no_more_is_said_in_one_line_and_the_export_goes_on_later(
    form: Format, logs: Logs, tmp_path: Path
) -> None:
    for size in (1_000, 50_000):
        with _no_file_larger_than(size), pytest.raises(LogError, match=r"File too large.*goes on where"):
            export([logs[0].path], tmp_path / "data", form)
        assert not (tmp_path / "data").exists()
    assert export([logs[0].path], tmp_path / "data", form).episodes == 1


def test_the_command_says_what_it_wrote(logs: Logs, tmp_path: Path, command_line) -> None:
    done = command_line("export", "--to", "hdf5", logs[0].path, logs[1].path, "data.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("wrote data.h5: 2 episodes")
    again = command_line("export", "--to", "hdf5", logs[0].path, "data.h5", cwd=tmp_path)
    assert (again.returncode, again.stdout) == (2, "")
    assert "data.h5 exists already" in again.stderr
