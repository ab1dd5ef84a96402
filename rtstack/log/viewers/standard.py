"""Foxglove's messages that a topic of the table may have: what viewers show without knowing our schema."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import foxglove
import numpy as np
from foxglove.messages import Log, LogLevel, PoseInFrame
from numpy.typing import NDArray

from rtstack.log.viewers.frames import stamp
from rtstack.log.viewers.shapes import pose
from rtstack.samples import Level

_LEVELS: dict[int, LogLevel] = {level: getattr(LogLevel, level.name.capitalize()) for level in Level}


@dataclass(frozen=True, slots=True)
class StandardMessage:
    """encode: one sample, and the frame of its first field, to the message; fill: the decoded message into a sample,
    (1,), but for its t_ns."""

    schema: foxglove.Schema
    encode: Callable[[np.void, str], bytes]
    fill: Callable[[NDArray[Any], Any], None]


def _encode_pose(sample: np.void, frame: str) -> bytes:
    at = pose(sample["position"], sample["orientation_wxyz"])
    return PoseInFrame(timestamp=stamp(int(sample["t_ns"])), frame_id=frame, pose=at).encode()


def _fill_pose(sample: NDArray[Any], message: Any) -> None:
    p, q = message.pose.position, message.pose.orientation
    sample["position"] = (p.x, p.y, p.z)
    sample["orientation_wxyz"] = (q.w, q.x, q.y, q.z)
    sample["seen"] = 1


def _encode_event(sample: np.void, _frame: str) -> bytes:
    name, text = (bytes(sample[field]).decode("utf-8", "replace") for field in ("name", "text"))
    level = _LEVELS.get(int(sample["level"]), LogLevel.Unknown)
    return Log(timestamp=stamp(int(sample["t_ns"])), level=level, name=name, message=text).encode()


def _fill_event(sample: NDArray[Any], message: Any) -> None:
    sample["level"] = message.level
    sample["name"] = message.name.encode("ascii", "replace")
    sample["text"] = message.message.encode("ascii", "replace")


STANDARD: dict[str, StandardMessage] = {
    "foxglove.PoseInFrame": StandardMessage(PoseInFrame.get_schema(), _encode_pose, _fill_pose),
    "foxglove.Log": StandardMessage(Log.get_schema(), _encode_event, _fill_event),
}
