"""HDF5 in the form of the TU/e Impact-Aware Robotics Database: one file, a group Rec_<UTC time> for each recording,
Rec_unknown_time where the log does not have the time of day.

The names in capitals, `datalog`, `transforms` and their attributes are those that the database's published readers ask
for (docs/howto/dataset.md says which parts are known).
"""

import io
import itertools
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hal.topic import Topic
from rtstack.datasets.episode import NONE, Episode, field_attributes
from rtstack.datasets.export import Format
from rtstack.topics import OBJECT_TOPIC, TOPICS

TIME = "Time(s)"  # the first column of a datalog, s since the recording's first sample
UTC = "utc_ns"  # the second one, where the log has the time of day
_FILTERS = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # which every reader of HDF5 has
_ROWS = 2048  # of a chunk: 2 s of the fastest topics
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


class Hdf5(Format):
    needs = ("h5py",)
    settings = "hdf5"

    def write(self, episode: Episode, path: Path) -> None:
        with _new_file(path) as file:
            began = None if episode.time is None else episode.time.utc(episode.start_ns)
            recording = file.create_group(f"Rec_{began:%Y%m%dT%H%M%SZ}" if began else "Rec_unknown_time")
            recording.attrs["recording_timestamp"] = f"{began:%Y-%m-%dT%H:%M:%SZ}" if began else NONE
            recording.attrs["note"] = f"{episode.facts['kind']}: {episode.task}"
            recording.attrs.update({**episode.facts, **episode.labels})
            recording["METADATA/source.json"] = episode.source
            for attachment in episode.attachments:
                kind = "ROBOT" if attachment.name.endswith(".urdf") else "ENVIRONMENT"
                binary = b"\0" in attachment.data  # as what a fault has left, which no text of HDF5 can hold
                content = np.void(attachment.data) if binary else attachment.data.decode(errors="replace")
                recording[f"{kind}/{attachment.name}"] = content
            for name, topic in TOPICS.items():
                if len(episode.records[name]):
                    self._sensor(recording, episode, topic)
            self._object(recording, episode)

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        """See Format. Compressed chunks are copied as they are."""
        import h5py

        with _new_file(whole) as target:
            target.attrs["note"] = "Trials of a dual-arm cell, made by rtstack export --to hdf5"
            target.attrs.update(about | {"left_out": json.dumps(about["left_out"])})
            for path in episodes:
                with h5py.File(path, "r") as source:
                    (name,) = source
                    free = (f"{name}{'' if k == 0 else f'_{k}'}" for k in itertools.count())
                    source.copy(name, target, next(each for each in free if each not in target))

    def _sensor(self, recording: Any, episode: Episode, topic: Topic) -> None:
        """Write a topic: a table of all its records, and what each column is, as attributes FIELD.unit and so on."""
        sensor = recording.create_group(f"SENSOR_MEASUREMENT/{topic.name[1:].replace('/', '_')}")
        sensor.attrs["model"], sensor.attrs["note"] = topic.message.schema, topic.message.text
        records = episode.records[topic.name]
        utc = [] if episode.time is None else [(UTC, "i8")]
        table = np.zeros(len(records), [(TIME, "f8"), *utc, *topic.record.descr])
        table[TIME] = 1e-9 * (records["t_ns"] - episode.start_ns)
        if episode.time is not None:
            table[UTC] = episode.time.unix_ns(records["t_ns"])
        table[list(topic.record.names or ())] = records
        log = sensor.create_dataset("datalog", data=table, chunks=(min(_ROWS, len(table)),), **_FILTERS)
        if topic.rate_hz:
            log.attrs.update({"sample_frequency": str(topic.rate_hz), "sample_frequency_unit": "Hz"})
        log.attrs.update({"duration": str(table[TIME][-1] - table[TIME][0]), "duration_unit": "s"})
        about = {"t_ns": {"unit": "ns", "description": "Robot's time."}, **field_attributes(topic)}
        about |= {UTC: {"unit": "ns", "description": "Unix time of t_ns."}} if utc else {}
        log.attrs.update({f"{name}.{key}": value for name, each in about.items() for key, value in each.items()})

    def _object(self, recording: Any, episode: Episode) -> None:
        """Write what is handled, as the cell's file has it, and where the tracker saw it."""
        name = episode.facts["object"]
        thing = episode.cell.get("objects", {}).get(name)
        if thing is None:
            return
        group = recording.create_group(f"OBJECT/{name}")
        of_corners = "vertices", _CORNERS * thing["size"], "m"
        for key, values, unit in (("mass", thing["mass"], "kg"), ("dimensions", thing["size"], "m"), of_corners):
            group.create_dataset(key, data=values).attrs["unit"] = unit
        poses = episode.records[OBJECT_TOPIC]
        poses = poses[poses["seen"] != 0]
        if len(poses):
            sensor = f"SENSOR_MEASUREMENT/{OBJECT_TOPIC[1:].replace('/', '_')}"
            T = np.tile(np.eye(4), (len(poses), 1, 1))
            T[:, :3, 3] = poses["position"]
            T[:, :3, :3] = Rotation.from_quat(poses["orientation_wxyz"], scalar_first=True).as_matrix()
            transforms = recording.create_dataset(f"{sensor}/POSTPROCESSING/{name}/transforms", data=T, **_FILTERS)
            transforms.attrs["note"] = "T_world_object, (n, 4, 4), row-major, m: of the rows whose `seen` is not 0"


class _Disk(io.FileIO):
    """A file that seems to be written where it could not be, and has the first error. The HDF5 library crashes the
    program when it is closed after a write that has failed, as on a full disk."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        while len(left) and self.error is None:
            try:
                left = left[super().write(left) :]
            except OSError as error:
                self.error = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return self.tell() if size is None else size


@contextmanager
def _new_file(path: Path) -> Iterator[Any]:
    """Yield a new file of h5py. Raises OSError at the end where something of it could not be written."""
    import h5py

    with _Disk(path, "w+") as disk:
        try:
            with h5py.File(disk, "w") as file:
                yield file
        finally:
            if disk.error is not None:
                raise disk.error
