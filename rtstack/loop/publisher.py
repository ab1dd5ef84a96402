"""Where the loop's samples go: any number of rings, and an in-memory history."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hal.tracker import OBJECT_POSE, ObjectPose, ObjectTracker
from rtstack.log.push import push_all
from rtstack.log.ring import Rings
from rtstack.loop.history import History
from rtstack.samples import EVENT, TIMING_SAMPLE, Level

_OF_A_TICK = ("/left/arm", "/left/control", "/right/arm", "/right/control", "/timing")


class Publisher:
    """Publishes a tick to every ring. Events are fixed-size records too: formatting happens on events only."""

    def __init__(self, rings: Sequence[Rings], history: History | None) -> None:
        self.timing = np.zeros(1, TIMING_SAMPLE)
        self._history = history
        self._event = np.zeros(1, EVENT)
        self._pushers = [[ring.pusher(topic) for topic in _OF_A_TICK] for ring in rings]
        self._left: tuple[NDArray, NDArray] | None = None
        self._right: tuple[NDArray, NDArray] | None = None
        self._rows = np.zeros((0, 5), np.int64)
        self._pose = self._last_pose = ObjectPose.empty().record
        self._moved_pose = np.zeros(1, OBJECT_POSE)
        self._stamp = self._seen = np.zeros(1, np.int64)
        self._pose_t_ns = -1
        self._pose_pushers = [ring.pusher("/object/pose").push for ring in rings]
        self._event_pushers = [ring.pusher("/events").push for ring in rings]

    def look(self, tracker: ObjectTracker, origin_ns: int = 0, now_ns: int = 0) -> None:
        """Take the object's pose for the next `tick`. origin_ns: robot's time that the log counts from, unless 0, and
        now_ns, how long ago that is. All stands still until the first answer: what was seen before then is how the
        object stands at the first state, and has its stamp.

        A robot that waits for its answer is asked before it has got one: afterwards its next pose may be there already.
        """
        seen = tracker.latest().record
        if not origin_ns:
            self._pose = seen
        else:
            self._moved_pose[:] = seen
            self._moved_pose["t_ns"][0] = min(max(0, seen["t_ns"].item() - origin_ns), now_ns)
            self._pose = self._moved_pose

    def tick(self, left: tuple[NDArray, NDArray], right: tuple[NDArray, NDArray]) -> None:
        """Publish the arm and control records (1,) of both arms, the timing, and the object's pose where it is new."""
        if left is not self._left or right is not self._right:
            self._bind(left, right)
        push_all(self._rows)
        if self._history is not None:
            self._history.append(left, right, self.timing)
        pose = self._pose
        if pose is not self._last_pose:
            self._last_pose, self._stamp, self._seen = pose, pose["t_ns"], pose["seen"]
        t_ns = self._stamp.item()
        if t_ns != self._pose_t_ns and self._seen[0]:
            self._pose_t_ns = t_ns
            for push in self._pose_pushers:
                push(pose)
            if self._history is not None:
                self._history.append_pose(pose)

    def _bind(self, left: tuple[NDArray, NDArray], right: tuple[NDArray, NDArray]) -> None:
        """Look up where the records are: the loop publishes the same ones every tick."""
        self._left, self._right = left, right
        records = (*left, *right, self.timing)
        rows = [p.bind(record) for each in self._pushers for p, record in zip(each, records, strict=True)]
        self._rows = np.array(rows, np.int64).reshape(-1, 5)

    def event(self, t_ns: int, level: Level, name: str, text: str) -> None:
        """Publish an event at the robot's time t_ns."""
        self._event["t_ns"][0] = t_ns
        self._event["level"][0] = level
        self._event["name"][0] = name.encode("ascii", "replace")
        self._event["text"][0] = text.encode("ascii", "replace")
        for push in self._event_pushers:
            push(self._event)
        if self._history is not None:
            self._history.append_event(self._event)
