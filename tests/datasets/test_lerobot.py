"""The LeRobot export: frames of the log's own bits, and back. tests/foreign asks lerobot's loader."""

import io
import json
import shutil
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from rtstack.datasets.export import export
from rtstack.datasets.lerobot import LeRobot, plain
from rtstack.datasets.lerobot_import import import_episode
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.playback.path import load_motion
from tests.support.console.review_log import time_in
from tests.support.log.samples import MS, WrittenLog, write_log
from tests.support.log.seen import write_seen_log
from tests.support.quaternions import changes_of_sign

Logs = tuple[WrittenLog, WrittenLog]
STEP = 20  # ticks of a frame at 50 Hz


@pytest.fixture(scope="module")
def data(logs: Logs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "grabs"
    export([log.path for log in logs], out, LeRobot())
    return out


def _frames(data: Path, number: int):
    return pq.read_table(data / "data", filters=[("episode_index", "=", number)])


def test_frames_have_the_logs_bits(data: Path, logs: Logs) -> None:
    begin = 0
    for number, log in enumerate(logs):
        table = _frames(data, number)
        left, right = log.columns["/left/arm"], log.columns["/right/arm"]
        count = len(left) // STEP
        assert len(table) == count
        at = STEP * np.arange(1, count + 1) - 1
        state = np.hstack([side[name][at] for name in ("q", "dq") for side in (left, right)])
        assert plain(table, "observation.state").tobytes() == state.tobytes()
        q = np.hstack([left["q"], right["q"]])[: STEP * count].reshape(count, STEP, 14)
        assert plain(table, "observation.q_1khz").tobytes() == q.tobytes()
        wanted = np.hstack([log.columns[f"/{side}/control"]["pose_ref"] for side in ("left", "right")])
        asked = wanted[np.minimum(at + STEP, STEP * count - 1)]
        assert np.abs(plain(table, "action")).tobytes() == np.abs(asked).tobytes()
        assert [changes_of_sign(plain(table, "action")[:, k : k + 4]) for k in (3, 10)] == [0, 0]
        assert table["frame_index"].to_pylist() == list(range(count))
        assert table["index"].to_pylist() == list(range(begin, begin + count))
        assert plain(table, "timestamp")[:, 0].tolist() == (np.arange(count) / 50).astype(np.float32).tolist()
        assert table["next.done"].to_pylist() == table["next.success"].to_pylist() == [False] * (count - 1) + [True]
        begin += count


def test_what_the_data_set_says_of_itself(data: Path, logs: Logs) -> None:
    info = json.loads((data / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 50, 2)
    assert info["total_frames"] == sum(len(log.columns["/timing"]) // STEP for log in logs)
    q, wrench = (info["features"][f"observation.{name}_1khz"] for name in ("q", "O_F_ext_hat_K"))
    assert (q["shape"], q["unit"], q["names"][0], q["names"][-1]) == ([20, 14], "rad", "left_q_1", "right_q_7")
    assert (wrench["unit"], wrench["frame"]) == ("N, Nm", "base")
    tasks = pq.read_table(data / "meta" / "tasks.parquet")
    assert tasks.to_pylist() == [{"task_index": 0, "task": "grab the rice box with both arms"}]
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    episodes = pq.read_table(data / "meta" / "episodes").to_pylist()
    assert [each["success"] for each in episodes] == ["true", "true"]
    assert [len(json.loads(each["events"])) for each in episodes] == [5, 5]
    stats = json.loads((data / "meta" / "stats.json").read_text())["action"]
    both = np.vstack([plain(_frames(data, number), "action") for number in (0, 1)])
    assert stats["mean"] == pytest.approx(both.mean(axis=0).tolist())
    assert stats["count"] == [len(both)]


def test_export_import_export_gives_identical_arrays(data: Path, tmp_path: Path) -> None:
    for number in (0, 1):
        import_episode(data, number, tmp_path / f"{number}.mcap")
    export([tmp_path / "0.mcap", tmp_path / "1.mcap"], tmp_path / "again", LeRobot())
    first, second = (pq.read_table(folder / "data") for folder in (data, tmp_path / "again"))
    assert first.column_names == second.column_names
    for name in first.column_names:
        assert plain(first, name).tobytes() == plain(second, name).tobytes(), name


def test_pictures_are_in_the_frames_as_the_camera_gave_them_and_come_back(logs: Logs, tmp_path: Path) -> None:
    source = tmp_path / "seen.mcap"
    camera, shown = write_seen_log(logs[0].path, source)
    begin_ns = read_log(source).start_ns
    tables = []
    for k in range(2):
        export([source], tmp_path / f"set{k}", LeRobot())
        tables.append(pq.read_table(tmp_path / f"set{k}" / "data"))
        import_episode(tmp_path / f"set{k}", 0, tmp_path / f"back{k}.mcap")
        source = tmp_path / f"back{k}.mcap"
    first, second = tables
    at_ns = begin_ns + (STEP * np.arange(1, len(first) + 1) - 1) * MS
    for frame_ns, taken_ns, image in zip(
        at_ns,
        first["timing.picture_t_ns.front"].to_pylist(),
        first["observation.images.front"].to_pylist(),
        strict=True,
    ):
        newest = [each for each in shown if each[0] <= frame_ns][-1:] or shown[:1]
        assert (taken_ns, image["bytes"]) == newest[0]
    assert first.equals(second)
    info = json.loads((tmp_path / "set0" / "meta" / "info.json").read_text())["features"]["observation.images.front"]
    assert (info["dtype"], info["shape"]) == ("image", [96, 400, 3])
    assert read_log(source).messages(camera.topics[1]) == list(camera.about(begin_ns)[camera.topics[1]])


def test_pictures_as_films_are_the_frames_pictures_and_come_back(logs: Logs, tmp_path: Path) -> None:
    _, shown = write_seen_log(logs[0].path, tmp_path / "seen.mcap")
    export([tmp_path / "seen.mcap"], tmp_path / "films", LeRobot(video=True))
    key = "observation.images.front"
    info = json.loads((tmp_path / "films" / "meta" / "info.json").read_text())
    row = pq.read_table(tmp_path / "films" / "meta" / "episodes").to_pylist()[0]
    table = _frames(tmp_path / "films", 0)
    assert (info["features"][key]["dtype"], key in table.column_names) == ("video", False)
    assert row[f"videos/{key}/to_timestamp"] - row[f"videos/{key}/from_timestamp"] == row["length"] / 50
    path = tmp_path / "films" / info["video_path"].format(video_key=key, chunk_index=0, file_index=0)
    with av.open(str(path)) as film:
        frames = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in film.decode(video=0)]
    assert [at for at, _ in frames] == pytest.approx([k / 50 for k in range(row["length"])])
    jpeg = dict(shown)
    for (_, picture), t_ns in zip(frames, table["timing.picture_t_ns.front"].to_pylist(), strict=True):
        taken = np.asarray(Image.open(io.BytesIO(jpeg[t_ns]))).astype(float)
        assert np.abs(picture - taken).mean() < 4.0
    import_episode(tmp_path / "films", 0, tmp_path / "back.mcap")
    back = read_log(tmp_path / "back.mcap").pictures("/camera/front/image")
    assert [t_ns for t_ns, _ in back] == sorted(set(table["timing.picture_t_ns.front"].to_pylist()))
    assert [time_in(picture) for _, picture in back] == [time_in(jpeg[t_ns]) for t_ns, _ in back]


def test_statistics_of_pictures_are_by_channel_as_lerobots_training_asks(logs: Logs, tmp_path: Path) -> None:
    write_seen_log(logs[0].path, tmp_path / "seen.mcap")
    export([tmp_path / "seen.mcap"], tmp_path / "grabs", LeRobot())
    frames = _frames(tmp_path / "grabs", 0)["observation.images.front"].to_pylist()
    pixels = np.stack([np.asarray(Image.open(io.BytesIO(each["bytes"]))) for each in frames]).reshape(-1, 3) / 255.0
    stats = json.loads((tmp_path / "grabs" / "meta" / "stats.json").read_text())["observation.images.front"]
    episode = pq.read_table(tmp_path / "grabs" / "meta" / "episodes").to_pylist()[0]
    for name, expected in (("mean", pixels.mean(axis=0)), ("std", pixels.std(axis=0)), ("max", pixels.max(axis=0))):
        assert np.shape(stats[name]) == (3, 1, 1)
        assert np.ravel(stats[name]) == pytest.approx(expected, abs=0.02)
        assert np.ravel(episode[f"stats/observation.images.front/{name}"]) == pytest.approx(expected, abs=0.02)


def test_without_the_ticks_a_data_set_has_the_frames_alone(data: Path, logs: Logs, tmp_path: Path) -> None:
    export([log.path for log in logs], tmp_path / "frames", LeRobot(ticks=False))
    whole, frames = pq.read_table(data / "data"), pq.read_table(tmp_path / "frames" / "data")
    assert frames.column_names == [name for name in whole.column_names if not name.endswith("_1khz")]
    assert frames.equals(whole.select(frames.column_names))
    assert set(json.loads((tmp_path / "frames/meta/info.json").read_text())["features"]) == set(frames.column_names)
    with pytest.raises(LogError, match="--no-ticks: a log is made of the 1 kHz samples"):
        import_episode(tmp_path / "frames", 0, tmp_path / "back.mcap")


def test_an_imported_episode_is_a_log_that_can_be_played(demonstration, tmp_path: Path) -> None:
    source = read_log(demonstration.path)
    export([demonstration.path], tmp_path / "grabs", LeRobot())
    ticks = round(1000 * import_episode(tmp_path / "grabs", 0, tmp_path / "back.mcap"))
    assert 0 <= source.count("/left/arm") - ticks < STEP
    back = read_log(tmp_path / "back.mcap")
    for topic in ("/left/arm", "/right/arm", "/left/control", "/timing"):
        assert back.topic(topic).tobytes() == source.topic(topic)[:ticks].tobytes()
    assert back.events == source.events
    assert back.metadata["trial"] == source.metadata["trial"]
    played, known = load_motion(tmp_path / "back.mcap"), load_motion(demonstration.path)
    assert (played.object, played.duration_s) == (known.object, known.duration_s)
    middle = np.linspace(0.0, 4.0, 50)
    assert played.joints(0, middle) == pytest.approx(known.joints(0, middle), abs=1e-3)


def test_a_tick_that_the_log_does_not_have_is_the_one_before(tmp_path: Path) -> None:
    """The right arm began 3 ms late and the object was seen after 30 ms: nothing of the future is in a frame."""
    from rtstack.datasets.episode import read_episode
    from rtstack.datasets.frames import frames_of

    log = write_log(tmp_path / "source.mcap", 100)
    episode = read_episode(log.path, "")
    right, poses = episode.records["/right/arm"], episode.records["/object/pose"]
    lost = np.r_[0:3, 50]
    episode.records["/right/arm"] = np.delete(right, lost)  # type: ignore[index]
    episode.records["/object/pose"] = poses[29:]  # type: ignore[index]
    frames = frames_of(episode, 50)
    ticks = frames["observation.q_1khz"].values.reshape(-1, 14)
    assert len(ticks) == 80
    assert ticks[47, 7:].tolist() == right["q"][49].tolist()
    assert ticks[47, :7].tolist() == log.columns["/left/arm"]["q"][50].tolist()
    seen = frames["observation.environment_state"].values
    assert poses["t_ns"][29] == 30 * MS
    assert (seen[0].tolist(), seen[1, 7]) == ([0.0] * 8, 1.0)


def test_what_is_wrong_is_one_line(data: Path, logs: Logs, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="--fps 30: frames begin at ticks of 1 kHz"):
        LeRobot(30)
    for folder, number, words in ((tmp_path, 0, "meta/info.json is missing"), (data, 2, "there is no episode 2")):
        with pytest.raises(LogError, match=words):
            import_episode(folder, number, tmp_path / "out.mcap")
    with pytest.raises(LogError, match="shorter than one frame at --fps 1"):
        export([logs[0].path], tmp_path / "short", LeRobot(1))
    assert not (tmp_path / "short").exists()


@pytest.mark.parametrize(
    "said", ["[]", "7", '{"codebase_version": "v3.0"}', '{"codebase_version": "v3.0", "total_episodes": "two"}']
)
def test_a_damaged_data_set_is_one_line(data: Path, tmp_path: Path, said: str) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(data, damaged)
    (damaged / "meta" / "info.json").write_text(said)
    with pytest.raises(LogError, match=r"^[^\n]*it is no data set of rtstack export --to lerobot: [^\n]*$"):
        import_episode(damaged, 0, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("row", [{"episode_index": 0}, {"episode_index": 0, "source": "[]", "attachments": "[1]"}])
def test_a_data_set_whose_episode_says_something_else_is_one_line(data: Path, tmp_path: Path, row: dict) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    damaged = tmp_path / "damaged"
    shutil.copytree(data, damaged)
    (file,) = (damaged / "meta" / "episodes").rglob("*.parquet")
    pq.write_table(pa.Table.from_pylist([{"data/chunk_index": 0, "data/file_index": 0} | row]), file)
    with pytest.raises(LogError, match="it is no data set of rtstack export --to lerobot"):
        import_episode(damaged, 0, tmp_path / "out.mcap")


@pytest.mark.parametrize("ticks", [True, False])
def test_a_data_set_of_another_robot_is_refused_for_what_it_is(logs: Logs, tmp_path: Path, ticks: bool) -> None:
    export([logs[0].path], tmp_path / "set", LeRobot(ticks=ticks))
    (file,) = (tmp_path / "set" / "meta" / "episodes").rglob("*.parquet")
    table = pq.read_table(file)
    pq.write_table(table.select([name for name in table.column_names if name not in ("source", "first_t_ns")]), file)
    with pytest.raises(LogError, match="it is no data set of rtstack export --to lerobot: its episodes do not have"):
        import_episode(tmp_path / "set", 0, tmp_path / "out.mcap")


def test_the_commands_export_and_import(logs: Logs, tmp_path: Path, command_line) -> None:
    done = command_line("export", "--to", "lerobot", "--fps", "100", logs[0].path, "grabs", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for kind, code, name in (("lerobot", 0, "frames"), ("hdf5", 2, "frames.h5")):
        done = command_line("export", "--to", kind, "--no-ticks", logs[0].path, name, cwd=tmp_path)
        assert done.returncode == code, done.stderr
    assert done.stderr == "rtstack: --no-ticks is of lerobot and zarr: hdf5 has every sample\n"
    names = pq.read_schema(next((tmp_path / "frames" / "data").rglob("*.parquet"))).names
    assert "action" in names
    assert "observation.q_1khz" not in names
    back = command_line("import", "grabs", "back.mcap", cwd=tmp_path)
    assert back.stdout == "wrote back.mcap: episode 0 of grabs, 0.43 s\n", back.stderr
