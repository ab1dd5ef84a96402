"""Where the loop's samples go: any number of rings, and an in-memory history."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hal.tracker import ObjectTracker
from rtstack.log.ring import Rings
from rtstack.loop.history import History
from rtstack.samples import EVENT, TIMING_SAMPLE, Level


class Publisher:
    """Publishes a tick to every ring. Events are fixed-size records too: formatting happens on events only."""

    def __init__(self, rings: Sequence[Rings], history: History | None) -> None:
        self.timing = np.zeros(1, TIMING_SAMPLE)
        self._history = history
        self._event = np.zeros(1, EVENT)
        self._pose_t_ns = -1
        self._pushers = [
            tuple(
                ring.pusher(topic).push
                for topic in ("/left/arm", "/left/control", "/right/arm", "/right/control", "/timing")
            )
            for ring in rings
        ]
        self._pose_pushers = [ring.pusher("/object/pose").push for ring in rings]
        self._event_pushers = [ring.pusher("/events").push for ring in rings]

    def tick(self, left: tuple[NDArray, NDArray], right: tuple[NDArray, NDArray], tracker: ObjectTracker) -> None:
        """Publish the arm and control records (1,) of both arms, the timing, and the object's pose where it is new."""
        for left_arm, left_control, right_arm, right_control, timing in self._pushers:
            left_arm(left[0])
            left_control(left[1])
            right_arm(right[0])
            right_control(right[1])
            timing(self.timing)
        if self._history is not None:
            self._history.append(left, right, self.timing)
        pose = tracker.latest().record
        t_ns = int(pose["t_ns"][0])
        if t_ns != self._pose_t_ns and pose["seen"][0]:
            self._pose_t_ns = t_ns
            for push in self._pose_pushers:
                push(pose)
            if self._history is not None:
                self._history.append_pose(pose)

    def event(self, t_ns: int, level: Level, name: str, text: str) -> None:
        """Publish an event at the robot's time t_ns."""
        self._event["t_ns"][0] = t_ns
        self._event["level"][0] = level
        self._event["name"][0] = name.encode("ascii", "replace")
        self._event["text"][0] = text.encode("ascii", "replace")
        for push in self._event_pushers:
            push(self._event)
