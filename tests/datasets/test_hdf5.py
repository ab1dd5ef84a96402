"""The HDF5 and Zarr exports are what their readers expect."""

import io
import json
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import zarr
from PIL import Image

from rtstack.datasets.episode import digest_of, read_episode
from rtstack.datasets.export import export
from rtstack.datasets.frames import frames_of
from rtstack.datasets.hdf5 import Hdf5
from rtstack.datasets.zarr import Zarr
from rtstack.log.errors import LogError
from rtstack.topics import TOPICS
from tests.support.log.samples import CELL, MS, RESULT, WrittenLog
from tests.support.log.seen import write_seen_log
from tests.support.quaternions import changes_of_sign, columns_of_one_sign, of_one_sign


def _zarr(path: Path) -> Any:
    """Return a Zarr group, whose content has no types."""
    return zarr.open_group(str(path), mode="r")


@pytest.fixture(scope="module")
def data(logs: tuple[WrittenLog, WrittenLog], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "data.h5"
    done = export([log.path for log in logs], out, Hdf5())
    assert (done.episodes, done.present) == (2, 0)
    assert list(out.parent.iterdir()) == [out]
    return out


def test_every_sample_of_every_topic_is_there_bit_for_bit(data: Path, logs: tuple[WrittenLog, WrittenLog]) -> None:
    with h5py.File(data) as file:
        for recording, log in zip(file.values(), logs, strict=True):
            for name, records in columns_of_one_sign(log.columns).items():
                table = recording[f"SENSOR_MEASUREMENT/{name[1:].replace('/', '_')}/datalog"][:]
                assert table["Time(s)"].tolist() == (1e-9 * (records["t_ns"] - records["t_ns"][0])).tolist()
                for column in records.dtype.names or ():
                    assert table[column].tobytes() == records[column].tobytes(), (name, column)


def test_units_frames_and_labels(data: Path) -> None:
    with h5py.File(data) as file:
        recording = next(iter(file.values()))
        assert recording.attrs["note"] == "trial: grab the rice box with both arms"
        assert (recording.attrs["success"], recording.attrs["impact_verdict"]) == ("true", "none")
        arm = recording["SENSOR_MEASUREMENT/left_arm/datalog"].attrs
        assert (arm["q.unit"], arm["O_F_ext_hat_K.unit"], arm["O_F_ext_hat_K.frame"]) == ("rad", "N, Nm", "base")
        assert (arm["sample_frequency"], arm["sample_frequency_unit"]) == ("1000", "Hz")
        missing = {
            f"{topic.name}: {field.name}"
            for topic in TOPICS.values()
            for field in topic.message.fields
            for key, value in (("unit", field.unit), ("frame", field.frame))
            if value and recording[f"SENSOR_MEASUREMENT/{topic.name[1:].replace('/', '_')}/datalog"].attrs[
                f"{field.name}.{key}"
            ] != value
        }  # fmt: skip
        assert missing == set()
        source = json.loads(recording["METADATA/source.json"].asstr()[()])
        assert source["result"] == RESULT
        assert len(source["sha256"]) == 64
        assert recording["ENVIRONMENT/cell.toml"][()] == CELL


def test_the_object_and_where_it_was(data: Path, logs: tuple[WrittenLog, WrittenLog]) -> None:
    with h5py.File(data) as file:
        recording = next(iter(file.values()))
        box = recording["OBJECT/rice_box"]
        assert (box["mass"][()], box["mass"].attrs["unit"]) == (1.25, "kg")
        assert np.ptp(box["vertices"][:], axis=0).tolist() == pytest.approx([0.2, 0.3, 0.2])
        transforms = recording["SENSOR_MEASUREMENT/object_pose/POSTPROCESSING/rice_box/transforms"][:]
        poses = logs[0].columns["/object/pose"]
        assert transforms[:, :3, 3].tobytes() == poses["position"].tobytes()
        assert transforms[:, :3, :3] @ transforms[:, :3, :3].transpose(0, 2, 1) == pytest.approx(
            np.tile(np.eye(3), (len(poses), 1, 1))
        )


def test_all_frames_of_all_episodes_are_there_bit_for_bit(logs: tuple[WrittenLog, WrittenLog], tmp_path: Path) -> None:
    paths, out = [log.path for log in logs], tmp_path / "data.zarr"
    assert export(paths, out, Zarr()).episodes == 2
    assert list(tmp_path.iterdir()) == [out]
    root = _zarr(out)
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
    data = _zarr(tmp_path / "data.zarr")["data"]
    times = data["timing.picture_t_ns.front"][:]
    jpeg = dict(shown)
    for k in (0, len(times) - 1):
        picture = np.array(Image.open(io.BytesIO(jpeg[int(times[k])])))
        np.testing.assert_array_equal(data["observation.images.front"][k], picture)


@pytest.mark.parametrize("zone", ["Asia/Tokyo", "America/New_York"])
def test_the_time_is_that_of_the_log_and_never_that_of_its_name(zone, write_short, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    good = {"kind": "trial"}, {"success": "true"}
    write_short("20261127-050000-trial.mcap", *good)
    write_short("20261127-060000-trial.mcap", *good, "2026-11-26T23:00:00.250000Z")
    export([tmp_path / "logs"], tmp_path / "data.h5", Hdf5())
    export([tmp_path / "logs"], tmp_path / "data.zarr", Zarr())
    with h5py.File(tmp_path / "data.h5") as file:
        groups = {name: dict(group.attrs) for name, group in file.items()}
        tables = [group["SENSOR_MEASUREMENT/left_arm/datalog"] for group in file.values()]
        assert tables[1].dtype.names[:2] == ("Time(s)", "t_ns")  # none, where there is no time
        assert tables[0]["utc_ns"][:3].tolist() == [1795734000250000000 + k * MS for k in range(3)]
    assert list(groups) == ["Rec_20261126T230000Z", "Rec_unknown_time"]
    assert [each["recording_timestamp"] for each in groups.values()] == ["2026-11-26T23:00:00Z", "none"]
    assert [each["recorded_utc"] for each in groups.values()] == ["2026-11-26T23:00:00.250000Z", "none"]
    assert [each["utc_uncertainty_s"] for each in groups.values()] == ["0.001", "none"]
    root = _zarr(tmp_path / "data.zarr")
    step_ns = 20 * MS
    begin_ns = 1795734000250000000 + 19 * MS
    assert root["data"]["timing.utc_ns"][:].tolist() == [-1] * 3 + [begin_ns + k * step_ns for k in range(3)]
    assert [each["recorded_utc"] for each in root["meta"].attrs["episodes"]] == ["none", "2026-11-26T23:00:00.250000Z"]


def test_rotations_keep_their_sign_also_where_w_is_nearly_zero(write_short, tmp_path: Path) -> None:
    """A pad that is turned by half a turn: w is noise about 0, and the sign of all four numbers went with it."""
    rng = np.random.default_rng(4)
    signs = []
    for k in range(2):
        w = 0.01 * rng.normal(size=60)
        poses = np.column_stack([w, np.full(60, 0.6), np.full(60, 0.0), np.sqrt(0.64 - w**2)])
        poses[w < 0] *= -1.0
        poses[30] = 0.0 if k else poses[30]  # it was not seen
        assert changes_of_sign(poses) > 10
        write_short(f"{k}.mcap", {"kind": "trial"}, {"success": "true"}, poses=poses)
        signs.append(of_one_sign(poses))
    export([tmp_path / "logs"], tmp_path / "data.h5", Hdf5())
    export([tmp_path / "logs"], tmp_path / "data.zarr", Zarr(100))
    with h5py.File(tmp_path / "data.h5") as file:
        for wanted, group in zip(signs, file.values(), strict=True):
            sensors = group["SENSOR_MEASUREMENT"]
            for topic in ("left_control", "right_control"):
                np.testing.assert_array_equal(sensors[topic]["datalog"]["pose_ref"][:, 3:], wanted)
            np.testing.assert_array_equal(sensors["object_pose/datalog"]["orientation_wxyz"], wanted)
            assert wanted[0, 1] > 0.5  # both begin alike
    data = _zarr(tmp_path / "data.zarr")["data"]
    for k, wanted in enumerate(signs):
        rows = slice(6 * k, 6 * k + 6)
        np.testing.assert_array_equal(data["observation.environment_state"][rows][:, 3:7], wanted[9::10])
        np.testing.assert_array_equal(data["action"][rows][:-1, 3:7], wanted[19::10])
        np.testing.assert_array_equal(data["control.pose_ref_1khz"][rows].reshape(60, 14)[:, 10:], wanted)


def test_frames_a_second_that_are_no_divisor_are_refused() -> None:
    with pytest.raises(LogError, match="--fps 30"):
        Zarr(30)
