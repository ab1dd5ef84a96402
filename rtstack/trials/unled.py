"""No references: the points of a session whose law follows something else, or nothing."""

import numpy as np

from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.end import End
from rtstack.loop.watchdogs import Watchdog, WatchdogTrip
from rtstack.samples import Level


class Unled(Watchdog):
    """A point source whose points are where the arms are, and a watchdog that ends it after so many seconds."""

    def __init__(self, seconds: float | None, arms: int) -> None:
        self.points = np.zeros((arms, 1), POINT)
        self._most_ns = None if seconds is None else round(seconds * 1e9)
        self._began_ns: int | None = None
        self._now_ns = 0

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: nothing is asked for."""

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write where the arm is: there is nothing to be followed."""
        point, work = self.points[side], arm.workspace[0]
        point["position"], point["rotation"] = work["position"], work["rotation"]
        if side == 0:
            self._now_ns = int(arm.sample["t_ns"][0])
            self._began_ns = self._now_ns if self._began_ns is None else self._began_ns

    def trip(self) -> WatchdogTrip | None:
        if self._most_ns is None or self._began_ns is None or self._now_ns - self._began_ns < self._most_ns:
            return None
        return WatchdogTrip(End.COMPLETED, "", Level.INFO)
