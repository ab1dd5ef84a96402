"""The tracker of a cell, `[tracker]`."""

import math
from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from hal.clock_relation import ClockRelation
from hal.pad import Quaternion, Vector
from hal.tracker import TagCamera, TrackerFrames, TrackerRequest, TrackerTimes

LARGEST_AGE_MS = 100.0  # ten frames of a slow tracker; ours
Clock = Literal["robot", "host", "own", "arrival"]
_CLOCKS: dict[str, Clock] = {"natnet": "own", "apriltag": "host"}  # of the kinds that have only one
NO_TRACKER = "none"  # kind, of a cell in which nothing sees the object


@checked(frozen=True, slots=True, config=STRICT)
class TrackedBody:
    """What a tracker follows of an object. id: its number of the rigid body. position m, orientation_wxyz: of the
    object's frame in the body's."""

    id: Annotated[int, Field(ge=0, lt=2**31)]
    position: Vector = (0.0, 0.0, 0.0)
    orientation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


@checked(frozen=True, slots=True, config=STRICT)
class TrackerDescription:
    """Where the object's poses come from, in which frame and with which times: see hal.tracker.

    kind: a name of rtstack.trackers. udp: datagrams (hal.tracker_link) that are sent to HOST:PORT; natnet: Motive at
    HOST:PORT; apriltag: `camera` sees a tag on the object; none: nothing sees the object. clock: of the poses' times,
    udp alone; position, orientation_wxyz: of the tracker's frame in the world. bodies: by the objects' names.
    largest_age_ms: None: 100, any by the robot's clock. place_tolerance_m: an object that is seen further from its
    place than this is put back before a trial.
    """

    kind: str = "udp"
    address: Annotated[str, Field(pattern=r"^[^\s:]+:\d{1,5}$")] = "127.0.0.1:1341"
    place_tolerance_m: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)] = 0.06
    clock: Clock = "robot"
    latency_ms: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 0.0
    largest_age_ms: Annotated[float, Field(gt=0.0)] | None = None
    multicast: Annotated[str, Field(pattern=r"^(\d{1,3}(\.\d{1,3}){3})?$")] = ""
    up: Literal["y", "z"] = "z"
    position: Vector = (0.0, 0.0, 0.0)
    orientation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    bodies: dict[str, TrackedBody] = field(default_factory=dict)
    camera: TagCamera | None = None

    def frames(self, object_name: str) -> TrackerFrames:
        """Return where tracker and object stand. Raises ValueError for an object that is not among the bodies."""
        thing = self.bodies.get(object_name)
        if self.bodies and object_name and thing is None:
            raise ValueError(f"[tracker.bodies] has no {object_name}; it has {', '.join(self.bodies)}")
        thing = thing or TrackedBody(0)
        return TrackerFrames(self.up, self.position, self.orientation_wxyz, thing.position, thing.orientation_wxyz)

    def request(self, object_name: str, robot_clock: ClockRelation) -> TrackerRequest:
        """Return what the tracker is opened with; see hal.tracker.TrackerRequest. Raises ValueError as `frames`."""
        host, _, port = self.address.rpartition(":")
        body = self.bodies.get(object_name) if object_name else next(iter(self.bodies.values()), None)
        clock: Clock = _CLOCKS.get(self.kind, self.clock)
        age_ms = self.largest_age_ms or (math.inf if clock == "robot" else LARGEST_AGE_MS)
        return TrackerRequest(
            host, int(port), self.frames(object_name), TrackerTimes(clock, self.latency_ms, age_ms),
            robot_clock, None if body is None else body.id, self.multicast, self.camera,
        )  # fmt: skip
