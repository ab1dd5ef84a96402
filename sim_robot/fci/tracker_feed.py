"""The simulated motion capture's way out: object poses as datagrams (hal.tracker_link) to one listener."""

import contextlib
import socket

import numpy as np

from hal.tracker import ObjectTracker
from hal.tracker_link import DATAGRAM


class TrackerFeed:
    """Sends each new pose of a tracker once. Never blocks; a listener that is not there is no error."""

    def __init__(self, tracker: ObjectTracker, listener: tuple[str, int]) -> None:
        self._tracker, self._behind_ns = tracker, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(listener)
        self._sent_t_ns = -1
        self._datagram = np.zeros(1, DATAGRAM)

    def publish(self, robot_t_ns: int, plant_t_ns: int) -> None:
        """Send the newest pose if it was not sent yet, stamped with the robot's time, as far as its clock is right.

        Call it before the state of that time goes out, so that who has the state has the pose too. plant_t_ns: what the
        poses' own time is now.
        """
        pose = self._tracker.latest().record
        t_ns = int(pose["t_ns"][0])
        if t_ns == self._sent_t_ns:
            return
        self._sent_t_ns = t_ns
        self._datagram[:] = pose
        self._behind_ns = plant_t_ns - t_ns
        self.repeat(robot_t_ns)

    def repeat(self, robot_t_ns: int) -> None:
        """Send the last pose again, with another time."""
        self._datagram["t_ns"] = robot_t_ns - self._behind_ns
        with contextlib.suppress(OSError):
            self._socket.send(self._datagram.data)

    def close(self) -> None:
        """Release the socket."""
        self._socket.close()
