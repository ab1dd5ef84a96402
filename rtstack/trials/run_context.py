"""What accompanies a run: its log, live rings, the stop signal, progress, watchdogs and an observer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rtstack.log.ring import Rings
from rtstack.loop.session import StopSignal
from rtstack.loop.watchdogs import Watchdog
from rtstack.trials.record import RunLog
from rtstack.trials.run_observer import RunObserver

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class RunContext:
    """What accompanies a run while the arms move. By default nothing: no log is written, and the run ends by itself.

    log: closed by the run, with the result in it; one that could not be finished fails the run, and the reason says so.
    live: rings for live viewers. stop: asked once a tick; the judge brakes at once. progress: called at times with the
    completed share of the run, 0 to 1. watchdogs: what has to give signs of life meanwhile, asked once a tick.
    run_observer: whose run_events go into the log, and who learns how the session ended.
    """

    log: RunLog | None = None
    live: Rings | None = None
    stop: StopSignal | None = None
    progress: Progress | None = None
    watchdogs: Sequence[Watchdog] = ()
    run_observer: RunObserver | None = None

    @property
    def listening(self) -> list[Rings]:
        """The rings that a run has to publish to."""
        return [*([self.live] if self.live else []), *(self.log.listening if self.log else ())]

    @property
    def log_name(self) -> str | None:
        """The log's path, None where nothing is written."""
        return str(self.log.path) if self.log is not None else None

    def with_watchdog(self, watchdog: Watchdog) -> "RunContext":
        """Return the same context with one more watchdog."""
        return replace(self, watchdogs=(*self.watchdogs, watchdog))


NO_CONTEXT = RunContext()
