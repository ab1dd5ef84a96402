"""LeRobot data sets, v3.0: the folder `data` with all frames, `meta`, and `videos`. lerobot's own loader reads it."""

import base64
import io
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rtstack.datasets.episode import Episode, Pictures
from rtstack.datasets.film import write_film
from rtstack.datasets.frames import Feature, FrameFormat, frames_of, pictures_at, span_of
from rtstack.log.errors import LogError
from rtstack.log.video import load_av
from rtstack.topics import CLOCK_TOPIC, EVENT_TOPIC

VERSION = "v3.0"
_FILE_BYTES, _FILES = 100_000_000, 1000  # of a data file, and how many a folder has: LeRobot's defaults
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
IMAGES, PICTURE_TIMES = "observation.images.", "timing.picture_t_ns."
_FRAMES, _PIXELS = "frames.parquet", "pixels.npz"  # of an episode's folder in OUT.partial, beside its videos
_LOOKED_AT, _EVERY = 10, 4  # statistics of pictures: so many frames of an episode, and of them every 4th row and column
_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
_DTYPES = {"f": "float64", "i": "int64", "b": "bool"}


class LeRobot(FrameFormat):
    """A Format, a folder with data and meta: see FrameFormat."""

    name = "lerobot"
    needs: tuple[str, ...] = ("pyarrow",)

    def __init__(self, fps: int = 50, ticks: bool = True, video: bool = False) -> None:
        """video: pictures as films of H.264, not as the JPEG that they are. Raises LogError, also without PyAV."""
        super().__init__(fps, ticks)
        self.video = video
        if video:
            load_av()
            self.settings += "-video"

    def write(self, episode: Episode, path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        features = frames_of(episode, self.fps, self.ticks)
        count = len(next(iter(features.values())).values)
        said = {
            "task": episode.task,
            "robot": "_".join(a.name.removesuffix(".urdf") for a in episode.attachments if a.name.endswith(".urdf")),
            "length": count,
            "labels": {**episode.labels, **episode.facts, **_kept(episode)},
            "features": {name: _described(feature) for name, feature in features.items()},
        }
        table = pa.table({name: _column(feature.values) for name, feature in features.items()})
        pixels: dict[str, NDArray] = {}
        path.mkdir()
        for camera, pictures in episode.pictures.items():
            at, name = pictures_at(episode, pictures, count, self.fps), IMAGES + camera
            pixels[name] = _pixels(pictures, at)
            kind, about = "image", {}
            if self.video:
                kind, about = "video", {"info": write_film(path / f"{name}.mp4", pictures, at, self.fps)}
            else:
                table = table.append_column(name, _image_column(pictures, at))
            width, height = Image.open(io.BytesIO(pictures.jpeg[0])).size
            names = ["height", "width", "channels"]
            said["features"][name] = {"dtype": kind, "shape": [height, width, 3], "names": names, **about}
            text = "When the picture was taken, of the robot's time."
            said["features"][PICTURE_TIMES + camera] = {
                "dtype": "int64", "shape": [1], "names": ["t_ns"], "unit": "ns", "description": text
            }  # fmt: skip
            times = np.array(pictures.t_ns, np.int64)[at]
            table = table.append_column(PICTURE_TIMES + camera, _column(times))
        with open(path / _PIXELS, "wb") as file:
            np.savez(file, **pixels)  # pyright: ignore[reportArgumentType]
        table = table.replace_schema_metadata({"rtstack": json.dumps(said)})
        pq.write_table(table, path / _FRAMES, compression="lz4", use_dictionary=False)  # fast before small

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        """See Format. Every episode is a row group of a data file."""
        import pyarrow.parquet as pq

        (whole / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
        tasks: dict[str, int] = {}
        rows: list[dict[str, Any]] = []
        shown: list[dict[str, NDArray]] = []  # the values that statistics are made of, by episode
        said: dict[str, Any] = {}
        features: dict[str, Any] = {}
        files = _DataFiles(whole)
        begin = 0
        for number, path in enumerate(episodes):
            table = pq.read_table(path / _FRAMES)
            said = json.loads(table.schema.metadata[b"rtstack"])
            table = table.replace_schema_metadata(None)
            if number and said["features"] != features:
                other = json.loads(said["labels"]["source"])["file"]
                raise LogError(f"{other}: its topics or arms are not those of the first log: export it by itself")
            features = said["features"]
            task, length = tasks.setdefault(said["task"], len(tasks)), said["length"]
            frame = np.arange(length)
            counted = {
                "timestamp": (frame / self.fps).astype(np.float32), "frame_index": frame,
                "episode_index": np.full(length, number), "index": begin + frame, "task_index": np.full(length, task),
            }  # fmt: skip
            for name, values in counted.items():
                table = table.append_column(name, _column(values))
            chunk, file = files.write(table)
            # a frame's numbers and pictures are described, its 1 kHz samples are not
            values = {name: plain(table, name) for name, each in _features(said).items() if len(each["shape"]) == 1}
            with np.load(path / _PIXELS) as pixels:
                values |= {name: pixels[name][:, :, None, None] / 255.0 for name in pixels.files}
            shown.append(values)
            placed = dict(zip(("chunk_index", "file_index"), divmod(number, _FILES), strict=True))
            films: dict[str, float] = {}
            for film in path.glob("*.mp4"):
                to = whole / VIDEO.format(video_key=film.stem, **placed)
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(film, to)
                times = {"from_timestamp": 0.0, "to_timestamp": length / self.fps}
                films |= {f"videos/{film.stem}/{key}": each for key, each in (placed | times).items()}
            rows.append({
                "episode_index": number, "tasks": [said["task"]], "length": length,
                "data/chunk_index": chunk, "data/file_index": file,
                "dataset_from_index": begin, "dataset_to_index": begin + length,
                "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0, **films, **said["labels"],
                **{f"stats/{name}/{key}": stat
                   for name, each in values.items() for key, stat in _statistics(each).items()},
            })  # fmt: skip
            begin += length
        files.close()
        self._meta(whole, rows, tasks, shown, said, begin)
        (whole / "meta" / "left_out.json").write_text(json.dumps(about, indent=1))

    def _meta(
        self, whole: Path, rows: list[dict[str, Any]], tasks: dict[str, int], shown: list[dict[str, NDArray]],
        said: dict[str, Any], frames: int,
    ) -> None:  # fmt: skip
        import pyarrow as pa
        import pyarrow.parquet as pq

        meta = whole / "meta"
        pq.write_table(pa.Table.from_pylist(rows), meta / "episodes" / "chunk-000" / "file-000.parquet")
        pq.write_table(_task_table(tasks), meta / "tasks.parquet")
        stats = {name: _statistics(np.concatenate([each[name] for each in shown])) for name in shown[0]}
        (meta / "stats.json").write_text(json.dumps(stats, indent=1))
        info = {
            "codebase_version": VERSION, "robot_type": said["robot"] or None, "total_episodes": len(rows),
            "total_frames": frames, "total_tasks": len(tasks), "chunks_size": _FILES,
            "data_files_size_in_mb": _FILE_BYTES // 1_000_000, "video_files_size_in_mb": 500, "fps": self.fps,
            "splits": {"train": f"0:{len(rows)}"}, "data_path": DATA,
            "video_path": VIDEO if self.video and any(name.startswith(IMAGES) for name in shown[0]) else None,
            "features": _features(said),
        }  # fmt: skip
        (meta / "info.json").write_text(json.dumps(info, indent=1))


def _kept(episode: Episode) -> dict[str, Any]:
    """Return what no frame has of a log, and `rtstack import` needs."""
    files = {each.name: [each.media_type, each.data.decode(errors="surrogateescape")] for each in episode.attachments}
    cameras = {
        name: {topic: [t_ns, base64.b64encode(message).decode()] for topic, (t_ns, message) in each.about.items()}
        for name, each in episode.pictures.items()
    }
    clock = _dictionaries(episode.records[CLOCK_TOPIC][-1:])  # by which its times are UTC
    said = {"events": json.dumps(_dictionaries(episode.records[EVENT_TOPIC])), "clock": json.dumps(clock)}
    written = {**said, "attachments": json.dumps(files), "cameras": json.dumps(cameras)}
    return {"first_t_ns": span_of(episode)[0], **written, "source": episode.source}


def _dictionaries(records: NDArray[Any]) -> list[dict[str, Any]]:
    names = records.dtype.names or ()
    return [dict(zip(names, (each.decode() if isinstance(each, bytes) else each for each in record), strict=True))
            for record in records.tolist()]  # fmt: skip


def _image_column(pictures: Pictures, at: NDArray[np.intp]) -> Any:
    """Return a camera's pictures at the frames as a column, unchanged."""
    import pyarrow as pa

    data = pa.array([pictures.jpeg[k] for k in at], pa.binary())
    return pa.StructArray.from_arrays([data, pa.array([None] * len(at), pa.string())], ["bytes", "path"])


def _pixels(pictures: Pictures, at: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Return the pixels (n, 3) that statistics are made of: some of some frames."""
    rows = np.unique(np.linspace(0, len(at) - 1, _LOOKED_AT).astype(int))
    some = [Image.open(io.BytesIO(pictures.jpeg[k])).convert("RGB") for k in at[rows]]
    return np.concatenate([np.asarray(each)[::_EVERY, ::_EVERY].reshape(-1, 3) for each in some])


def _described(feature: Feature) -> dict[str, Any]:
    values = feature.values
    shape = list(values.shape[1:]) or [1]
    return {"dtype": _DTYPES[values.dtype.kind], "shape": shape, "names": list(feature.names), **feature.attributes}


def _features(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return what info.json says of all features: ours, and those that every data set has."""
    own = {name: {"dtype": "int64", "shape": [1], "names": None}
           for name in ("frame_index", "episode_index", "index", "task_index")}  # fmt: skip
    return {**said["features"], "timestamp": {"dtype": "float32", "shape": [1], "names": None, "unit": "s"}, **own}


def _column(values: NDArray) -> Any:
    """Return values (n, ...) as a column: a number, a list of fixed length, or a list of lists for each row."""
    import pyarrow as pa

    values = np.ascontiguousarray(values)
    if values.ndim == 1:
        return pa.array(values)
    flat = pa.array(values.reshape(-1))
    if values.ndim == 2:
        return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    for length in values.shape[:0:-1]:
        flat = pa.ListArray.from_arrays(np.arange(0, len(flat) + 1, length, dtype=np.int32), flat)
    return flat


def plain(table: Any, name: str) -> NDArray:
    """Return a column of numbers or of lists (of lists) of one length as (n, values) or (n, rows, values)."""
    flat = table[name].combine_chunks()
    shape = [len(flat)]
    while flat.type.num_fields:
        count, flat = len(flat), flat.flatten()
        shape.append(len(flat) // count)
    return flat.to_numpy(zero_copy_only=False).reshape(shape if len(shape) > 1 else (-1, 1))


def _statistics(values: NDArray) -> dict[str, list[Any]]:
    """Return LeRobot's statistics of values (n, m) or (n, 3, 1, 1), of all n, and the count."""
    found = values.astype(np.float64)
    reduced = {"min": found.min(axis=0), "max": found.max(axis=0), "mean": found.mean(axis=0), "std": found.std(axis=0)}
    reduced |= dict(zip(_QUANTILES, np.quantile(found, list(_QUANTILES.values()), axis=0), strict=True))
    return {name: each.tolist() for name, each in reduced.items()} | {"count": [len(values)]}


def _task_table(tasks: Mapping[str, int]) -> Any:
    """Return the tasks as pandas would write them: the words are the index."""
    import pyarrow as pa

    def column(name: str, kind: str, numpy: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}

    columns = [column("task_index", "int64", "int64"), column("task", "unicode", "object")]
    described = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = pa.table({"task_index": list(tasks.values()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(described)})


class _DataFiles:
    """The files of frames: a new one where the last one is full."""

    def __init__(self, whole: Path) -> None:
        self._whole, self._number = whole, -1
        self._writer: Any = None
        self._path = whole

    def write(self, table: Any) -> tuple[int, int]:
        """Add an episode, and return the numbers of its folder and file."""
        import pyarrow.parquet as pq

        if self._writer is None or self._path.stat().st_size > _FILE_BYTES:
            self.close()
            self._number += 1
            chunk, file = divmod(self._number, _FILES)
            self._path = self._whole / DATA.format(chunk_index=chunk, file_index=file)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(
                self._path, table.schema, compression="zstd", compression_level=1, use_dictionary=False
            )
        self._writer.write_table(table)
        return divmod(self._number, _FILES)

    def close(self) -> None:
        """Complete the last file."""
        if self._writer is not None:
            self._writer.close()
