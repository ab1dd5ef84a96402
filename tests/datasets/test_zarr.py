"""The Zarr export is what a replay buffer reads: arrays of all frames, and where episodes end."""

import io
from pathlib import Path

import numpy as np
import pytest
import zarr
from PIL import Image

from rtstack.datasets.episode import digest_of, read_episode
from rtstack.datasets.export import export
from rtstack.datasets.frames import frames_of
from rtstack.datasets.zarr import Zarr
from rtstack.log.errors import LogError
from tests.support.log.samples import WrittenLog
from tests.support.log.seen import write_seen_log


def test_all_frames_of_all_episodes_are_there_bit_for_bit(logs: tuple[WrittenLog, WrittenLog], tmp_path: Path) -> None:
    paths, out = [log.path for log in logs], tmp_path / "data.zarr"
    assert export(paths, out, Zarr()).episodes == 2
    assert list(tmp_path.iterdir()) == [out]
    root = zarr.open_group(str(out), mode="r")
    episodes = [frames_of(read_episode(path, digest_of(path)), 50) for path in paths]
    counts = [len(each["action"].values) for each in episodes]
    assert root["meta/episode_ends"][:].tolist() == np.cumsum(counts).tolist()
    assert set(root["data"]) == set(episodes[0])
    for name in episodes[0]:
        wanted = np.concatenate([each[name].values for each in episodes])
        array = root["data"][name]
        assert (array.dtype, array[:].tobytes()) == (wanted.dtype, wanted.tobytes()), name
    assert root["data"]["observation.state"].attrs["unit"] == "rad, rad/s"
    assert [each["success"] for each in root["meta"].attrs["episodes"]] == [
        read_episode(path, "").labels["success"] for path in paths
    ]


def test_pictures_are_arrays(logs, tmp_path: Path) -> None:
    _, shown = write_seen_log(logs[0].path, tmp_path / "seen.mcap", count=3)
    export([tmp_path / "seen.mcap"], tmp_path / "data.zarr", Zarr())
    data = zarr.open_group(str(tmp_path / "data.zarr"), mode="r")["data"]
    times = data["timing.picture_t_ns.front"][:]
    jpeg = dict(shown)
    for k in (0, len(times) - 1):
        picture = np.array(Image.open(io.BytesIO(jpeg[int(times[k])])))
        np.testing.assert_array_equal(data["observation.images.front"][k], picture)


def test_frames_a_second_that_are_no_divisor_are_refused() -> None:
    with pytest.raises(LogError, match="--fps 30"):
        Zarr(30)
