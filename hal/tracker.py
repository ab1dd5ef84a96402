"""The object tracker (motion capture): where the object is, as the tracker saw it."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as Bounds
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Array
from hal.base.configuration import STRICT, NotNegative, Positive, Real
from hal.base.record import POSITION, QUATERNION, Field, record_of
from hal.clock_relation import ClockRelation

OBJECT_POSE_FIELDS = (
    Field("position", "Position of the object, {unit}.", "m", POSITION, frame="world"),
    Field("orientation_wxyz", "Orientation of the object, a unit quaternion.", "", QUATERNION, frame="world"),
    Field("seen", "0 until the tracker has seen the object.", kind="i8", plotted=False),
)
OBJECT_POSE = record_of(OBJECT_POSE_FIELDS)
"""The record of a pose: t_ns, position (3,) m and orientation_wxyz (4,) in the world, seen."""


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


@checked(frozen=True, slots=True, config=STRICT)
class TagCamera:
    """[tracker.camera] of a cell's file: a camera with calibrated intrinsics, and the tags that it looks for.

    source: a device that OpenCV opens (0, /dev/video0), or unix:PATH, where a program of the camera's maker sends grey
    pictures (hal.trackers.apriltag.PICTURE, and then the pixels). focal, centre: px, of pictures of this size;
    distortion: k1, k2, p1, p2, k3 of OpenCV. family: of the tags; tag_size: of the outer edge of its black square, m.
    """

    source: str
    size: tuple[Annotated[int, Bounds(gt=0)], Annotated[int, Bounds(gt=0)]]
    focal: tuple[Positive, Positive]
    centre: tuple[Real, Real]
    tag_size: Positive
    distortion: tuple[Real, Real, Real, Real, Real] = (0.0, 0.0, 0.0, 0.0, 0.0)
    family: Literal["16h5", "25h9", "36h10", "36h11"] = "36h11"
    rate_hz: NotNegative = 0.0

    @property
    def matrix(self) -> Array:
        """The camera's matrix, (3, 3), px."""
        return np.array([[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class TrackerFrames:
    """Where a tracker and what it sees stand. m, unit quaternions wxyz.

    up: the tracker's vertical axis; with y, its x is kept and its z points to where y would (Motive streams so).
    position, orientation_wxyz: of the tracker's frame, then with z up, in the world. object_position,
    object_orientation_wxyz: of the object's frame in that of the rigid body that the tracker follows.
    """

    up: Literal["y", "z"] = "z"
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    object_position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    object_orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class TrackerTimes:
    """What a tracker's times mean.

    clock: "robot", the robot's time; "host", time.monotonic_ns of this host; "own", ns of any clock that runs evenly;
    "arrival", none. latency_ms: from the exposure to the time stamp, by the host's clock, else to the arrival of the
    least delayed messages; not used by the robot's. largest_age_ms: an object that was seen longer ago counts as not
    seen; never, by inf.
    """

    clock: Literal["robot", "host", "own", "arrival"] = "robot"
    latency_ms: float = 0.0
    largest_age_ms: float = float("inf")


@dataclass(frozen=True, slots=True)
class TrackerRequest:
    """What a tracker is opened with: [tracker] of a cell's file.

    host, port: its address. body: the tracker's number of the object's rigid body, None where it knows one only.
    multicast: the group to which the tracker sends, "" for none. robot_clock: of the robot's time (a) and the host's
    time.monotonic_ns (b); it becomes known with the arms' first states. camera: of who looks for tags.
    """

    host: str
    port: int
    frames: TrackerFrames
    times: TrackerTimes
    robot_clock: ClockRelation
    body: int | None = None
    multicast: str = ""
    camera: TagCamera | None = None


class ClosableTracker(ObjectTracker, Protocol):
    """A tracker that a cell has opened, and closes.

    It may also have `trouble(about: bool) -> str`: in one line what keeps it from showing the object, and what to do,
    as the end of a sentence that begins with its address; "" for nothing. about: the run is about an object.
    """

    def close(self) -> None:
        """Stop listening. Never raises."""
