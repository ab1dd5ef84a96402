"""Object poses over UDP: one datagram is one record of hal.tracker.OBJECT_POSE, little-endian, robot's time."""

import contextlib
import socket

import numpy as np

from hal.tracker import OBJECT_POSE, ObjectPose

DATAGRAM = OBJECT_POSE.newbyteorder("<")


class TrackerLink:
    """An ObjectTracker that listens at a loopback or network address. `address` is where to send."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen; port 0 takes a free one. Raises OSError."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except BaseException:
            self._socket.close()
            raise
        self.address: tuple[str, int] = self._socket.getsockname()
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        self._datagram = np.zeros(1, DATAGRAM)
        self._overlong = bytearray(DATAGRAM.itemsize + 1)

    def latest(self) -> ObjectPose:
        """Return the newest pose that has arrived, without blocking. Datagrams of another size are ignored."""
        with contextlib.suppress(BlockingIOError):
            while True:
                if self._socket.recv_into(self._overlong) == DATAGRAM.itemsize:
                    self._datagram.view(np.uint8)[:] = self._overlong[:-1]
                    self._seen.record[:] = self._datagram
        self._given.record[:] = self._seen.record
        return self._given

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()
