"""What the cameras of a run show while it runs, for a policy. The log gets its pictures with a policy and without."""

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.log.video import BEGINS, Decoder, pixels_of
from rtstack.log.writing.pictures import SLOTS, PictureRing

_PATIENCE_S = 5.0  # of a run that waits for a picture: drawing takes 0.03 s, a program that starts some seconds
_LOOK_S = 0.001


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of a camera, as the log has it, or decoded from it. t_ns: when it was taken, ns of the robot's time."""

    t_ns: int
    jpeg: bytes

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Its pixels (rows, columns, 3)."""
        return pixels_of(self.jpeg).copy()


class _Shown:
    """The last pictures of one camera. period_ns: between two of them, 0 for a run that does not wait for them."""

    def __init__(self, ring: PictureRing, period_ns: int) -> None:
        self.ring, self._period_ns = ring, period_ns
        self._pictures: deque[Picture] = deque(maxlen=SLOTS)
        self._decoder: Decoder | None = None
        self._first_ns: int | None = None
        self._next, self._gave_up = 0, -1

    def take(self) -> None:
        found, self._next = self.ring.since(self._next)
        if found and self._first_ns is None:
            self._first_ns = found[0][0]
        self._pictures.extend(Picture(t_ns, jpeg) for t_ns, data in found if (jpeg := self._jpeg(data)))

    def _jpeg(self, data: bytes) -> bytes:
        if not data.startswith(BEGINS):
            return data
        self._decoder = self._decoder or Decoder()
        return self._decoder.jpeg() if self._decoder.take(data) else b""

    def lacks(self, t_ns: int) -> bool:
        """Whether a picture is due by t_ns that is still to come."""
        if self._first_ns is None:
            return True
        behind_ns = t_ns - self._first_ns
        return self._pictures[-1].t_ns < self._first_ns + behind_ns // self._period_ns * self._period_ns

    def wait(self, t_ns: int) -> None:
        """Wait for what is due by t_ns. A camera that was quiet for long is waited for once it shows something."""
        self.take()
        until_s = time.monotonic() + _PATIENCE_S
        while self._period_ns and self._gave_up != self._next and self.lacks(t_ns):
            if time.monotonic() > until_s or self.ring.error:
                self._gave_up = self._next
            time.sleep(_LOOK_S)
            self.take()

    def at(self, t_ns: int) -> Picture | None:
        return next((each for each in reversed(self._pictures) if each.t_ns <= t_ns), None)


class NewestPictures:
    """The newest picture of each camera. rings: the names of their rings, by the cameras' names; periods_ns: of those
    that a run that waits has to wait for. Raises OSError where a ring is not there."""

    def __init__(self, rings: Mapping[str, str], periods_ns: Mapping[str, int] = {}) -> None:
        self._shown = {name: _Shown(PictureRing.attach(ring), periods_ns.get(name, 0)) for name, ring in rings.items()}

    def at(self, t_ns: int) -> dict[str, Picture]:
        """Return the newest picture of each camera that was taken at the robot's time t_ns or before."""
        found = {}
        for name, shown in self._shown.items():
            shown.wait(t_ns)
            if (picture := shown.at(t_ns)) is not None:
                found[name] = picture
        return found

    def close(self) -> None:
        for shown in self._shown.values():
            shown.ring.close()
