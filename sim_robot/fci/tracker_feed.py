"""The simulated motion capture's way out: object poses as datagrams (hal.tracker_link) to one listener."""

import argparse
import contextlib
import functools
import socket
import sys
from typing import Any

import numpy as np

from hal.tracker import ObjectTracker
from hal.tracker_link import DATAGRAM
from sim_robot.fci import __main__ as entry
from sim_robot.fci.server import Server


class TrackerFeed:
    """Sends each new pose of a tracker once. Never blocks; a listener that is not there is no error."""

    def __init__(self, tracker: ObjectTracker, listener: tuple[str, int]) -> None:
        self._tracker = tracker
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(listener)
        self._sent_t_ns = -1
        self._datagram = np.zeros(1, DATAGRAM)

    def publish(self, robot_t_ns: int) -> None:
        """Send the newest pose if it was not sent yet, stamped with the robot's time of the state it belongs to.

        Call it before that state goes out, so that who has the state has the pose too.
        """
        pose = self._tracker.latest().record
        t_ns = int(pose["t_ns"][0])
        if t_ns == self._sent_t_ns:
            return
        self._sent_t_ns = t_ns
        self._datagram[:] = pose
        self._datagram["t_ns"] = robot_t_ns
        with contextlib.suppress(OSError):
            self._socket.send(self._datagram.data)

    def close(self) -> None:
        """Release the socket."""
        self._socket.close()


class TrackedServer(Server):
    """A server that publishes what the motion capture sees, before the states of the same millisecond."""

    def __init__(self, *arguments: Any, listener: tuple[str, int]) -> None:
        super().__init__(*arguments)
        self._feed = TrackerFeed(self.cell.tracker, listener)
        self._feed.publish(0)

    def advance(self) -> None:
        """Advance, then publish."""
        super().advance()
        moving = [station for station in self.stations if station.moving]
        self._feed.publish((max(s.message_id for s in moving or self.stations) + 1) * 1_000_000)

    def close(self) -> None:
        """Close every socket."""
        super().close()
        self._feed.close()


def main(arguments: list[str] | None = None) -> int:
    """Serve as `python -m sim_robot.fci` does, with --tracker HOST:PORT."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--tracker", required=True, help="HOST:PORT that listens for object poses")
    options, rest = parser.parse_known_args(arguments)
    host, _, port = options.tracker.rpartition(":")
    entry.Server = functools.partial(TrackedServer, listener=(host, int(port)))
    return entry.main(rest)


if __name__ == "__main__":
    sys.exit(main())
