"""The clutch of one job in the mailbox: what a page holds, while what it does is not led by targets."""

import time
from collections.abc import Callable

import numpy as np

from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET, Release
from rtstack.loop.watchdogs import CLUTCH_S, WatchdogTrip
from rtstack.samples import Level

RELEASE_TEXTS: dict[int, str] = {
    Release.RELEASED: "the clutch was let go",
    Release.LOST: "the page lost the operator's hand",
}


def released(release: int) -> WatchdogTrip:
    """Return why a session ends whose clutch was let go."""
    return WatchdogTrip(End.RELEASED, RELEASE_TEXTS.get(release, "for no reason given"), Level.INFO)


def quiet(quiet_ns: int) -> WatchdogTrip | None:
    """Return why a session ends whose clutch has been quiet for so long, None where that is allowed."""
    quiet_s = quiet_ns * 1e-9
    if quiet_s <= CLUTCH_S:
        return None
    detail = f"no sign of life of the clutch for {quiet_s:.3g} s, allowed {CLUTCH_S:g} s"
    return WatchdogTrip(End.CLUTCH_QUIET, detail, value=quiet_s, bound=CLUTCH_S)


class Clutch:
    """A watchdog that ends a session with its clutch. clock: the host's monotonic time, ns."""

    def __init__(self, mailbox: Mailbox, job: int, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._mailbox, self._job, self._clock = mailbox, job, clock
        self._target = np.zeros(1, TARGET)
        self._beat_ns = self._release = 0

    @property
    def held(self) -> bool:
        """Whether it is held now."""
        if self._mailbox.read_target(self._target) and self._target["job"][0] == self._job:
            self._beat_ns, self._release = int(self._target["clutch_ns"][0]), int(self._target["release"][0])
        return self._beat_ns > 0

    def trip(self) -> WatchdogTrip | None:
        """See rtstack.loop.watchdogs.Watchdog."""
        return quiet(self._clock() - self._beat_ns) if self.held else released(self._release)
