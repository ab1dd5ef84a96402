"""Cameras by PyAV (the extra `video`): a device of V4L2, and a film, a file that is played in the robot's time."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtstack.cameras.source import CameraRequest
from rtstack.log.video import load_av
from rtstack.model.cell_description import load_cell_description

_ALONE_S = 1.0  # without a picture of a device: it is gone
_SAME_S = 1e-3  # times of a film are rounded to its time base
_LONGEST_STAMP_S = 1.0  # a driver's stamp that is further from now is of another clock


class _Source:
    """The pictures of what PyAV opens, at the size that the cell's file says. Raises OSError."""

    def __init__(self, request: CameraRequest, **options: Any) -> None:
        self._av, self._size = load_av(), (request.camera.width, request.camera.height)
        self._name = request.camera.address
        if not self._name:
            raise OSError(f"[cameras.{request.name}] address is missing: the device or the file")
        try:
            self._container = self._av.open(self._name, **options)
            self._stream = self._container.streams.video[0]
        except (self._av.FFmpegError, IndexError) as error:
            raise OSError(f"{self._name} cannot be opened: {error}") from None
        self._arm = request.rings.reader(f"/{load_cell_description(request.cell_file).sides[0]}/arm")
        self._frames = self._decoded()

    def _decoded(self) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Yield when each picture was taken, s of its own clock, and (rows, columns, 3) RGB."""
        try:
            for frame in self._container.decode(self._stream):
                if (frame.width, frame.height) != self._size:
                    raise OSError(f"{self._name} has pictures of {frame.width} x {frame.height}, not of {self._size}")
                yield frame.time or 0.0, frame.to_ndarray(format="rgb24")
        except self._av.FFmpegError as error:
            raise OSError(f"{self._name}: {error}") from None

    def close(self) -> None:
        self._container.close()


class Device(_Source):
    """A camera of V4L2, address /dev/videoN. A picture has the driver's time where that is of the host's monotonic
    clock, else the time at which it came; both as the robot's, of the newest state that the loop has passed on."""

    def __init__(self, request: CameraRequest) -> None:
        camera = request.camera
        options = {"video_size": f"{camera.width}x{camera.height}", "framerate": f"{camera.rate_hz:g}"}
        super().__init__(request, format="v4l2", options=options, timeout=_ALONE_S)

    def read(self) -> tuple[int, NDArray[np.uint8]] | None:
        found = next(self._frames, None)
        if found is None:
            raise OSError(f"{self._name} gives no more pictures")
        taken_s, picture = found
        latest = self._arm.latest()
        if latest is None:  # the run has not begun
            return None
        age_s = time.monotonic() - taken_s
        return int(latest["t_ns"][0]) - round(1e9 * age_s * (0.0 <= age_s < _LONGEST_STAMP_S)), picture


class Film(_Source):
    """A file, as of a camera that was turned on as the run began; address is its path."""

    def __init__(self, request: CameraRequest) -> None:
        super().__init__(request)
        self._period_ns = round(1e9 / request.camera.rate_hz)
        shown, self._next = next(self._frames, None), next(self._frames, None)
        if shown is None:
            raise OSError(f"{self._name} has no pictures")
        self._shown, self._begin_s, self._begin_ns = shown, shown[0], -1
        self._due_ns, self._now_ns = 0, -1

    def read(self) -> tuple[int, NDArray[np.uint8]] | None:
        samples = self._arm.drain()
        if len(samples):
            self._now_ns = int(samples["t_ns"][-1])
            if self._begin_ns < 0:
                self._begin_ns = self._due_ns = int(samples["t_ns"][0])
        if self._begin_ns < 0 or self._due_ns > self._now_ns:
            return None
        t_ns, self._due_ns = self._due_ns, self._due_ns + self._period_ns
        now_s = self._begin_s + 1e-9 * (t_ns - self._begin_ns) + _SAME_S
        while self._next is not None and self._next[0] <= now_s:
            self._shown, self._next = self._next, next(self._frames, None)
        if self._next is None and now_s > self._shown[0] + 1e-9 * self._period_ns:
            raise OSError(f"{self._name} is over")
        return t_ns, self._shown[1].copy()
