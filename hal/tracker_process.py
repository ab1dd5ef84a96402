"""A tracker's own process: it speaks with what sees the object, and passes poses on as our datagrams."""

import contextlib
import subprocess
import sys

from hal.tracker import ObjectPose, TrackerRequest
from hal.tracker_link import TrackerLink

_END_S = 1.0  # to end by itself


class TrackerProcess:
    """A link, and the module of ours that feeds it: `python -m MODULE ARGUMENTS... HOST PORT` of the link.

    Raises OSError.
    """

    def __init__(self, request: TrackerRequest, module: str, *arguments: str, options: tuple[str, ...] = ()) -> None:
        self._link = TrackerLink("127.0.0.1", 0, request.frames, request.times, request.robot_clock)
        command = [sys.executable, "-m", module, *arguments, *map(str, self._link.address), *options]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)

    def latest(self) -> ObjectPose:
        """Return the newest pose, see hal.tracker_link.TrackerLink."""
        return self._link.latest()

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self._process.kill()
        self._process.wait()
        self._link.close()
