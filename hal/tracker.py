"""The object tracker (motion capture): where the object is, as the tracker saw it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hal.record import POSITION, QUATERNION, Field, record_of

OBJECT_POSE_FIELDS = (
    Field("position", "Position of the object, {unit}.", "m", POSITION, frame="world"),
    Field("orientation_wxyz", "Orientation of the object, a unit quaternion.", "", QUATERNION, frame="world"),
    Field("seen", "0 until the tracker has seen the object.", kind="i8", plotted=False),
)
OBJECT_POSE = record_of(OBJECT_POSE_FIELDS)


@dataclass(frozen=True, slots=True)
class ObjectPose:
    """A record of dtype OBJECT_POSE, shape (1,), and views of its arrays. Owned and overwritten by the tracker."""

    record: NDArray[np.void]
    position: NDArray[np.float64]
    orientation_wxyz: NDArray[np.float64]

    @classmethod
    def empty(cls) -> "ObjectPose":
        """Return a pose that was not seen yet, at the origin."""
        record = np.zeros(1, OBJECT_POSE)
        record["orientation_wxyz"][0, 0] = 1.0
        return cls(record=record, position=record["position"][0], orientation_wxyz=record["orientation_wxyz"][0])

    @property
    def t_ns(self) -> int:
        """Robot's time at which the object was seen, ns."""
        return int(self.record["t_ns"][0])


class ObjectTracker(Protocol):
    """Source of object poses at 100 Hz or more."""

    def latest(self) -> ObjectPose:
        """Return the newest pose without blocking. It belongs to the tracker and is overwritten by the next call."""
        ...


class ClosableTracker(ObjectTracker, Protocol):
    """A tracker that a cell has opened, and closes."""

    def close(self) -> None:
        """Stop listening. Never raises."""
        ...
