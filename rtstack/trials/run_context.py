"""Who accompanies a run: its log, whoever watches it, and everybody who may end it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rtstack.log.ring import Rings
from rtstack.loop.session import StopSignal
from rtstack.loop.watchdogs import Watchdog
from rtstack.trials.attendant import Attendant
from rtstack.trials.record import RunLog

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Company:
    """Who is there while the arms move; by default nobody: nothing is written, and the run ends by itself.

    log: closed by the run, with the result in it; one that could not be finished fails the run, and the reason says so.
    live: rings of whoever watches. stop: asked once a tick; the judge brakes at once. progress: told now and then which
    share of the run is over, 0 to 1. watchdogs: what has to give signs of life meanwhile, asked once a tick.
    attendant: whose remarks go into the log, and who learns how the session ended.
    """

    log: RunLog | None = None
    live: Rings | None = None
    stop: StopSignal | None = None
    progress: Progress | None = None
    watchdogs: Sequence[Watchdog] = ()
    attendant: Attendant | None = None

    @property
    def listening(self) -> list[Rings]:
        """The rings that a run has to publish to."""
        return [*([self.live] if self.live else []), *(self.log.listening if self.log else ())]

    @property
    def log_name(self) -> str | None:
        """The log's path, None where nothing is written."""
        return str(self.log.path) if self.log is not None else None

    def joined_by(self, watchdog: Watchdog) -> "Company":
        """Return the same company with one more watchdog."""
        return replace(self, watchdogs=(*self.watchdogs, watchdog))


NOBODY = Company()
