"""LeRobot data sets, v3.0: the folder `data` with all frames, `meta`, and `videos`. lerobot's own loader reads it."""

import base64
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtstack.datasets.episode import Episode
from rtstack.datasets.film import film_info, write_film
from rtstack.datasets.frames import IMAGES, FrameFormat, span_of, written
from rtstack.log.video import load_av, pixels_of
from rtstack.topics import CLOCK_TOPIC, EVENT_TOPIC

VERSION = "v3.0"
_FILE_BYTES, _FILES = 100_000_000, 1000  # of a data file, and how many a folder has: LeRobot's defaults
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_FRAMES = "frames.npz"  # of an episode's folder in OUT.partial, beside its videos
_LOOKED_AT, _EVERY = 10, 4  # statistics of pictures: so many frames of an episode, and of them every 4th row and column
_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
_COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")  # features of every data set


class LeRobot(FrameFormat):
    """A folder with data and meta: see FrameFormat."""

    name = "lerobot"
    needs = ("pyarrow",)

    def __init__(self, fps: int = 50, ticks: bool = True, video: bool = False) -> None:
        """video: pictures as films of H.264, not as the JPEG that they are. Raises LogError, also without PyAV."""
        super().__init__(fps, ticks)
        self.video = video
        if video:
            load_av()
            self.settings += "-video"

    def kept(self, episode: Episode) -> dict[str, Any]:
        """Return what no frame has of a log, and `rtstack import` needs."""
        files = {a.name: [a.media_type, a.data.decode(errors="surrogateescape")] for a in episode.attachments}
        cameras = {
            name: {topic: [t_ns, base64.b64encode(message).decode()] for topic, (t_ns, message) in each.about.items()}
            for name, each in episode.pictures.items()
        }
        said = {
            "events": _dictionaries(episode.records[EVENT_TOPIC]), "attachments": files, "cameras": cameras,
            "clock": _dictionaries(episode.records[CLOCK_TOPIC][-1:]),  # by which its times are UTC
        }  # fmt: skip
        texts = {name: json.dumps(each) for name, each in said.items()}
        return {"first_t_ns": span_of(episode)[0], **texts, "source": episode.source}

    def write(self, episode: Episode, path: Path) -> None:
        path.mkdir()
        super().write(episode, path / _FRAMES)
        if self.video:
            for said, values in written([path / _FRAMES]):
                for name in [name for name in said["features"] if name.startswith(IMAGES)]:
                    write_film(path / f"{name}.mp4", values[name], self.fps)

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        """See Format. Every episode is a row group of a data file."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        meta = whole / "meta"
        (meta / "episodes" / "chunk-000").mkdir(parents=True)
        tasks: dict[str, int] = {}
        rows: list[dict[str, Any]] = []
        shown: list[dict[str, NDArray]] = []  # the values that statistics are made of, by episode
        features: dict[str, Any] = {}
        robot, begin, files = "", 0, -1
        data, writer = whole, None
        for number, (said, values) in enumerate(written([path / _FRAMES for path in episodes])):
            features, robot, length = dict(said["features"]), said["robot"], len(values["action"])
            task, frame = tasks.setdefault(said["task"], len(tasks)), np.arange(length)
            images = {name: values.pop(name) for name in features if name.startswith(IMAGES)}
            values |= {
                "timestamp": (frame / self.fps).astype(np.float32), "frame_index": frame,
                "episode_index": np.full(length, number), "index": begin + frame, "task_index": np.full(length, task),
            }  # fmt: skip
            columns = {name: _column(each) for name, each in values.items()}
            placed = dict(zip(("chunk_index", "file_index"), divmod(number, _FILES), strict=True))
            films: dict[str, float] = {}
            for name, jpeg in images.items():
                if not self.video:
                    parts = [pa.array(jpeg, pa.binary()), pa.nulls(length, pa.string())]
                    columns[name] = pa.StructArray.from_arrays(parts, ["bytes", "path"])
                    continue
                to = whole / VIDEO.format(video_key=name, **placed)
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(episodes[number] / f"{name}.mp4", to)
                times = {"from_timestamp": 0.0, "to_timestamp": length / self.fps}
                films |= {f"videos/{name}/{key}": each for key, each in (placed | times).items()}
                height, width, _ = features[name]["shape"]
                features[name] = features[name] | {"dtype": "video", "info": film_info(height, width, self.fps)}
            features |= {name: {"dtype": str(values[name].dtype), "shape": [1], "names": None} for name in _COUNTED}
            features["timestamp"]["unit"] = "s"
            table = pa.table({name: columns[name] for name in features if name in columns})
            if writer is None or data.stat().st_size > _FILE_BYTES:
                if writer is not None:
                    writer.close()
                files += 1
                data = whole / DATA.format(chunk_index=files // _FILES, file_index=files % _FILES)
                data.parent.mkdir(parents=True, exist_ok=True)
                options: dict[str, Any] = {"compression": "zstd", "compression_level": 1, "use_dictionary": False}
                writer = pq.ParquetWriter(data, table.schema, **options)
            writer.write_table(table)
            # a frame's numbers and pictures are described, its 1 kHz samples are not
            shown.append({name: each.reshape(length, -1) for name, each in values.items() if each.ndim < 3})
            shown[-1] |= {name: _pixels(jpeg) for name, jpeg in images.items()}
            rows.append({
                "episode_index": number, "tasks": [said["task"]], "length": length,
                "data/chunk_index": files // _FILES, "data/file_index": files % _FILES,
                "dataset_from_index": begin, "dataset_to_index": begin + length,
                "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0, **films, **said["labels"],
                **{f"stats/{name}/{key}": stat
                   for name, each in shown[-1].items() for key, stat in _statistics(each).items()},
            })  # fmt: skip
            begin += length
        if writer is not None:
            writer.close()
        pq.write_table(pa.Table.from_pylist(rows), meta / "episodes" / "chunk-000" / "file-000.parquet")
        pq.write_table(_task_table(tasks), meta / "tasks.parquet")
        stats = {name: _statistics(np.concatenate([each[name] for each in shown])) for name in shown[0]}
        films_are = self.video and any(name.startswith(IMAGES) for name in features)
        info = {
            "codebase_version": VERSION, "robot_type": robot or None, "total_episodes": len(rows),
            "total_frames": begin, "total_tasks": len(tasks), "chunks_size": _FILES,
            "data_files_size_in_mb": _FILE_BYTES // 1_000_000, "video_files_size_in_mb": 500, "fps": self.fps,
            "splits": {"train": f"0:{len(rows)}"}, "data_path": DATA, "video_path": VIDEO if films_are else None,
            "features": features,
        }  # fmt: skip
        for name, content in (("stats", stats), ("info", info), ("left_out", about)):
            (meta / f"{name}.json").write_text(json.dumps(content, indent=1))


def _dictionaries(records: NDArray[Any]) -> list[dict[str, Any]]:
    names = records.dtype.names or ()
    return [dict(zip(names, (each.decode() if isinstance(each, bytes) else each for each in record), strict=True))
            for record in records.tolist()]  # fmt: skip


def _pixels(jpeg: Sequence[bytes]) -> NDArray[np.float64]:
    """Return the pixels (n, 3, 1, 1), 0 to 1, that statistics are made of: some of some frames."""
    some = [pixels_of(jpeg[k]) for k in np.unique(np.linspace(0, len(jpeg) - 1, _LOOKED_AT).astype(int))]
    return np.concatenate([each[::_EVERY, ::_EVERY].reshape(-1, 3, 1, 1) for each in some]) / 255.0


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

    columns = [{"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
               for name, kind, numpy in (("task_index", "int64", "int64"), ("task", "unicode", "object"))]  # fmt: skip
    described = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = pa.table({"task_index": list(tasks.values()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(described)})
