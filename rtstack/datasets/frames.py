"""An episode as frames at a divisor of 1 kHz, and in each the 1 kHz samples since the last one.

A frame is at the last tick of its interval: what it observes was known then. Features: docs/howto/dataset.md.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.record import Field
from hal.state import ARM_STATE_FIELDS
from hal.topic import Topic
from rtstack.datasets.episode import Episode, Pictures, continuous, field_attributes, quaternions_of
from rtstack.datasets.export import Format
from rtstack.log.errors import LogError
from rtstack.log.video import pixels_of
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS, OBJECT_TOPIC, TICK_TOPICS, TOPICS

IMAGES, PICTURE_TIMES = "observation.images.", "timing.picture_t_ns."
_SAID, _ENDS = "said", ".ends"
_DTYPES = {"f": "float64", "i": "int64", "b": "bool"}
TICK_NS, TICKS = 1_000_000, 1000  # of a tick, and how many a second has
_MEASURED = {field.name for field in ARM_STATE_FIELDS}


@dataclass(frozen=True, slots=True)
class Feature:
    """What a frame has under a name. values: (n, ...), a row a frame. names: of the values in the last axis."""

    values: NDArray
    names: tuple[str, ...]
    attributes: Mapping[str, str]

    @property
    def about(self) -> dict[str, Any]:
        """What it is, in LeRobot's words."""
        shape, kind = list(self.values.shape[1:]) or [1], _DTYPES[self.values.dtype.kind]
        return {"dtype": kind, "shape": shape, "names": list(self.names), **self.attributes}


class FrameFormat(Format):
    """A data set of frames. fps: a divisor of 1000; ticks: with the 1 kHz samples. Raises LogError."""

    name: str
    alike = True

    def __init__(self, fps: int = 50, ticks: bool = True) -> None:
        if not 1 <= fps <= TICKS or TICKS % fps:
            raise LogError(f"--fps {fps}: frames begin at ticks of 1 kHz, so that 1000 is a multiple of it, as of 50")
        self.fps, self.ticks, self.settings = fps, ticks, f"{self.name}-{fps}-" + ("ticks" if ticks else "frames")

    def check(self, episode: Episode) -> None:
        """See Format: it has to be as long as one frame."""
        first_ns, last_ns = span_of(episode)
        if (last_ns - first_ns) // TICK_NS + 1 < TICKS // self.fps:
            raise LogError(f"{episode.path}: it is shorter than one frame at --fps {self.fps}")

    def kept(self, episode: Episode) -> dict[str, Any]:
        """Return what the data set keeps of an episode beside its frames, labels and facts."""
        return {"source": episode.source}

    def write(self, episode: Episode, path: Path) -> None:
        """See Format: the values of the frames, the pictures' JPEG, and what they are, as one file of NumPy."""
        features = frames_of(episode, self.fps, self.ticks)
        arrays = {name: feature.values for name, feature in features.items()}
        about = {name: feature.about for name, feature in features.items()}
        for camera, pictures in episode.pictures.items():
            at, name = pictures_at(episode, pictures, len(arrays["action"]), self.fps), IMAGES + camera
            jpeg = [pictures.jpeg[k] for k in at]
            arrays[name] = np.frombuffer(b"".join(jpeg), np.uint8)
            arrays[name + _ENDS] = np.cumsum([len(each) for each in jpeg])
            shape = list(pixels_of(jpeg[0]).shape)
            about[name] = {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}
            text = {"unit": "ns", "description": "When the picture was taken, of the robot's time."}
            times = Feature(np.array(pictures.t_ns, np.int64)[at], ("t_ns",), text)
            arrays[PICTURE_TIMES + camera], about[PICTURE_TIMES + camera] = times.values, times.about
        labels = {**episode.labels, **episode.facts, **self.kept(episode)}
        robot = "_".join(a.name.removesuffix(".urdf") for a in episode.attachments if a.name.endswith(".urdf"))
        said = {"file": episode.path.name, "task": episode.task, "robot": robot, "labels": labels, "features": about}
        arrays[_SAID] = np.frombuffer(json.dumps(said).encode(), np.uint8)
        with open(path, "wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]


def written(paths: Sequence[Path]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield of each file of FrameFormat.write what it says, and its values by feature; of a camera the JPEG of each
    frame. Raises LogError for one whose features are not those of the first."""
    features = None
    for path in paths:
        with np.load(path) as file:
            values: dict[str, Any] = dict(file)
        said = json.loads(values.pop(_SAID).tobytes())
        features = features or said["features"]
        if said["features"] != features:
            why = "its topics, arms or cameras are not those of the first log: export it by itself"
            raise LogError(f"{said['file']}: {why}")
        for name in [name for name in features if name.startswith(IMAGES)]:
            values[name] = [each.tobytes() for each in np.split(values[name], values.pop(name + _ENDS)[:-1])]
        yield said, values


def pictures_at(episode: Episode, pictures: Pictures, count: int, fps: int) -> NDArray[np.intp]:
    """Return which picture was the newest at each of the frames, (count,); before the first one it is that."""
    frames_ns = span_of(episode)[0] + TICK_NS * (TICKS // fps * np.arange(1, count + 1) - 1)
    return np.maximum(np.searchsorted(pictures.t_ns, frames_ns, side="right") - 1, 0)


def span_of(episode: Episode) -> tuple[int, int]:
    """Return from when to when all arms have samples, ns of the robot's time."""
    arms = [episode.records[topic]["t_ns"] for topic in _topics(ARM_TOPICS, episode.sides)]
    return max(int(t_ns[0]) for t_ns in arms), min(int(t_ns[-1]) for t_ns in arms)


def frames_of(episode: Episode, fps: int, ticks: bool = True) -> dict[str, Feature]:
    """Return what the frames of an episode have, by name: (n, ...) each.

    The samples of a tick are those of its time, or the newest before it where the log has none of that time. ticks:
    these samples too.
    """
    step = TICKS // fps
    first_ns, last_ns = span_of(episode)
    frames = ((last_ns - first_ns) // TICK_NS + 1) // step
    times = first_ns + TICK_NS * np.arange(frames * step)
    at = {
        name: records[np.maximum(np.searchsorted(records["t_ns"], times, side="right") - 1, 0)]
        for name, records in episode.records.items()
        if len(records) and TOPICS[name].rate_hz
    }
    frame_ns = times[step - 1 :: step]
    found: dict[str, Feature] = {}
    arms, controls = (_topics(topics, episode.sides) for topics in (ARM_TOPICS, CONTROL_TOPICS))
    state = [_of_arms(at, arms, _field(TOPICS[arms[0]], name)) for name in ("q", "dq")]
    found["observation.state"] = Feature(
        np.hstack([each.values for each in state])[step - 1 :: step], sum((each.names for each in state), ()),
        {"unit": "rad, rad/s", "description": "Joint positions of all arms, then joint velocities."},
    )  # fmt: skip
    wanted = _of_arms(at, controls, _field(TOPICS[controls[0]], "pose_ref"))
    ends = np.minimum(step * np.arange(2, frames + 2) - 1, len(times) - 1)
    asked = wanted.values[ends]
    for k in quaternions_of(wanted.names):
        asked[:, k : k + 4] = continuous(asked[:, k : k + 4], begins=False)  # of frames that are far apart
    found["action"] = Feature(asked, wanted.names, {
        **wanted.attributes, "description": f"{wanted.attributes['description']} At the next frame."
    })  # fmt: skip
    pose = np.zeros(frames, TOPICS[OBJECT_TOPIC].record)
    if OBJECT_TOPIC in at:
        known = at[OBJECT_TOPIC][step - 1 :: step]
        pose = np.where(known["t_ns"] <= frame_ns, known, pose)  # none before the first
    utc_ns = np.full(frames, -1) if episode.time is None else episode.time.unix_ns(frame_ns)
    text = "Unix time of the frame; -1 where the log has no time of day."
    found["timing.utc_ns"] = Feature(utc_ns, ("utc_ns",), {"unit": "ns", "description": text})
    found["observation.environment_state"] = Feature(
        np.column_stack([pose["position"], continuous(pose["orientation_wxyz"]), pose["seen"]]),
        ("x", "y", "z", "qw", "qx", "qy", "qz", "seen"),
        {"unit": "m", "frame": "world", "description": "The object's pose as the tracker saw it; seen: whether."},
    )
    # every field of the topics of every tick: all arms' beside each other, left before right
    for name, topics, field in tick_features(episode.sides) if ticks else ():
        if all(topic in at for topic in topics):
            feature = _of_arms(at, topics, field)
            found[name] = Feature(feature.values.reshape(frames, step, -1), feature.names, feature.attributes)
    ended = np.arange(frames) == frames - 1
    for name, values in (("next.done", ended), ("next.success", ended & (episode.labels["success"] == "true"))):
        found[name] = Feature(values, (name,), {})
    return found


def _topics(of_arms: Sequence[str], sides: Sequence[str]) -> tuple[str, ...]:
    return tuple(topic for topic in of_arms if TOPICS[topic].group in sides)


def tick_features(sides: Sequence[str] = SIDES) -> Iterator[tuple[str, tuple[str, ...], Field]]:
    """Yield the features of 1 kHz samples of a log with these arms: name, the topics of its values, and their field."""
    arms, controls = (_topics(topics, sides) for topics in (ARM_TOPICS, CONTROL_TOPICS))
    others = [(name,) for name in TICK_TOPICS if name not in (*ARM_TOPICS, *CONTROL_TOPICS)]
    for topics in (arms, controls, *others):
        for field in TOPICS[topics[0]].message.fields:
            prefix = "observation" if topics == arms and field.name in _MEASURED else "control"
            prefix = topics[0][1:].replace("/", "_") if topics in others else prefix
            yield f"{prefix}.{field.name}_1khz", topics, field


def _of_arms(at: Mapping[str, NDArray], topics: Sequence[str], field: Field) -> Feature:
    """Return a field of several topics at all ticks, (n, values), one topic's values after the other's."""
    values = np.hstack([at[topic][field.name].reshape(len(at[topic]), -1) for topic in topics])
    axes = field.axes or ("",)
    groups = [TOPICS[topic].group for topic in topics]
    names = tuple("_".join(filter(None, (group, field.name, axis))) for group in groups for axis in axes)
    return Feature(values, names, field_attributes(TOPICS[topics[0]])[field.name])


def _field(topic: Topic, name: str) -> Field:
    return next(field for field in topic.message.fields if field.name == name)
