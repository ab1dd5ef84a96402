"""An episode of a LeRobot data set that rtstack exported becomes a log again: for `rtstack play`, review and plot.

The log lacks what has no frame: the ticks after the last one, and the object's poses between two frames.
"""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from hal.base.files import replacing
from rtstack.datasets.export import check_installed
from rtstack.datasets.film import film_pictures
from rtstack.datasets.frames import IMAGES, PICTURE_TIMES, TICK_NS, tick_features
from rtstack.datasets.lerobot import DATA, VERSION, VIDEO, LeRobot, plain
from rtstack.log.errors import LogError
from rtstack.log.writing.job import Attachment
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log.writing.pictures import camera_schemas, camera_topics, picture_message
from rtstack.samples import SIDES
from rtstack.topics import CLOCK_TOPIC, EVENT_TOPIC, OBJECT_TOPIC, TOPICS

_POSE = "observation.environment_state"


def import_episode(folder: Path, number: int, out: Path) -> float:
    """Write the log `out` of an episode, and return how long it is, s. Raises LogError with one line."""
    if not (folder / "meta" / "info.json").is_file():
        raise LogError(f"{folder}: it is no LeRobot data set: meta/info.json is missing")
    check_installed(LeRobot.needs)
    try:
        row, table, sides = _episode(folder, number)
        source = json.loads(row["source"])
        attachments = [Attachment(name, kind, text.encode(errors="surrogateescape")) for name, (kind, text) in
                       json.loads(row["attachments"]).items()]  # fmt: skip
        records, cameras = _records(row, table, sides), json.loads(row.get("cameras", "{}"))
        pictures = _pictures(folder, row, table, cameras)
        metadata = {k: v for k, v in source.items() if isinstance(v, dict) and k not in ("result", "log")}
    except LogError:
        raise
    except Exception as error:  # pyarrow and numpy raise whatever a damaged table makes of them
        raise _refusal(folder, error) from None
    try:
        with replacing(out) as partial, open(partial, "wb") as file:
            writer = McapWriter(file, {topic: each for name in cameras for topic, each in camera_schemas(name).items()})
            writer.begin(metadata.items(), attachments)
            writer.write(records)
            if pictures:
                writer.write({}, pictures)
            writer.finish(source.get("result", {}), "imported", None, {})
    except OSError as error:
        raise LogError(f"cannot write {out}: {error.strerror}") from None
    except Exception as error:  # what was read is no sample, metadata or result
        raise _refusal(folder, error) from None
    return 1e-9 * TICK_NS * len(next(iter(records.values())))


def _refusal(folder: Path, error: Exception) -> LogError:
    said = (str(error) or type(error).__name__).splitlines()[0]
    return LogError(f"{folder}: it is no data set of rtstack export --to lerobot: {said}")


def _pictures(
    folder: Path, row: dict[str, Any], table: Any, cameras: dict[str, dict[str, tuple[int, str]]]
) -> dict[str, list[tuple[int, bytes]]]:
    """Return the messages of all cameras, by topic: the pictures that frames have; calibration and frame unchanged."""
    made: dict[str, list[tuple[int, bytes]]] = {}
    for name, about in cameras.items():
        times, key = table[PICTURE_TIMES + name].to_pylist(), IMAGES + name
        if key in table.column_names:
            images = [each["bytes"] for each in table[key].to_pylist()]
        else:
            places = {each: row[f"videos/{key}/{each}"] for each in ("chunk_index", "file_index")}
            images = film_pictures(folder / VIDEO.format(video_key=key, **places))
        shown = dict(zip(times, images, strict=True))
        made[camera_topics(name)[0]] = [(t_ns, picture_message(name, t_ns, jpeg)) for t_ns, jpeg in shown.items()]
        made |= {topic: [(t_ns, base64.b64decode(said))] for topic, (t_ns, said) in about.items()}
    return made


def _episode(folder: Path, number: int) -> tuple[dict[str, Any], Any, tuple[str, ...]]:
    """Return what the data set says of an episode, the table of its frames, and the sides of its arms."""
    import pyarrow.parquet as pq

    info = json.loads((folder / "meta" / "info.json").read_text())
    if info.get("codebase_version") != VERSION:
        raise ValueError(f"its version is {info.get('codebase_version')}, read is {VERSION}")
    if not 0 <= number < info["total_episodes"]:
        raise LogError(f"{folder}: there is no episode {number}; it has {info['total_episodes']}, from 0")
    about = [("episode_index", "=", number)]
    (row,) = pq.read_table(folder / "meta" / "episodes", filters=about).to_pylist()
    if not {"source", "first_t_ns"} <= row.keys():
        raise ValueError("its episodes do not have the log that they were made of (source, first_t_ns)")
    if not any(name in info["features"] for name, _, _ in tick_features()):
        raise LogError(f"{folder} was exported with --no-ticks: a log is made of the 1 kHz samples")
    data = folder / DATA.format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
    state = info["features"]["observation.state"]["names"]
    sides = tuple(side for side in SIDES if any(name.startswith(f"{side}_") for name in state))
    return row, pq.read_table(data, filters=about), sides


def _records(row: dict[str, Any], table: Any, sides: tuple[str, ...]) -> dict[str, Any]:
    """Return the records of all topics, as the log had them."""
    frames = len(table)
    found: dict[str, Any] = {}
    for name, topics, field in tick_features(sides):
        if name not in table.column_names:
            continue
        values = plain(table, name)
        ticks = values.size // values.shape[-1]
        for k, part in enumerate(np.split(values.reshape(ticks, -1), len(topics), axis=1)):
            topic = TOPICS[topics[k]]
            records = found.setdefault(topic.name, np.zeros(ticks, topic.record))
            records["t_ns"] = row["first_t_ns"] + TICK_NS * np.arange(ticks)
            records[field.name] = part.reshape(records[field.name].shape)
    ticks = len(next(iter(found.values())))
    poses = np.zeros(frames if _POSE in table.column_names else 0, TOPICS[OBJECT_TOPIC].record)
    if len(poses):
        values, step = plain(table, _POSE), ticks // frames
        poses["t_ns"] = row["first_t_ns"] + TICK_NS * (step * np.arange(1, frames + 1) - 1)
        poses["position"], poses["orientation_wxyz"], poses["seen"] = values[:, :3], values[:, 3:7], values[:, 7]
        poses = poses[poses["seen"] != 0]
    found[OBJECT_TOPIC] = poses
    for topic, key in ((EVENT_TOPIC, "events"), (CLOCK_TOPIC, "clock")):
        said = json.loads(row.get(key) or "[]")
        found[topic] = np.zeros(len(said), TOPICS[topic].record)
        for record, values in zip(found[topic], said, strict=True):
            for name, value in values.items():
                record[name] = value
    return found
