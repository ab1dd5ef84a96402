"""What accompanies a run: its log, live rings, the stop signal, progress, watchdogs and an observer."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.session import StopSignal
from rtstack.loop.watchdogs import Watchdog
from rtstack.samples import Level
from rtstack.trials.record import RunLog


@dataclass(frozen=True, slots=True)
class RunEvent:
    """An event that came from outside of the loop: its level, its source, one line of text."""

    level: Level
    name: str
    text: str


class RunObserver(Protocol):
    """Called between ticks and at the end; never waits or raises."""

    def run_events(self) -> Iterable[RunEvent]:
        """Return the events since the last call, oldest first."""
        ...

    def ended(self, end: End, detail: str) -> None:
        """Receive how the session ended, once both arms are at rest."""


Progress = Callable[[float], None]


class SoftStop(Protocol):
    """A source of soft-stop requests. Read once a tick."""

    @property
    def asked(self) -> bool:
        """Whether it is asked for."""
        ...


@dataclass(frozen=True, slots=True)
class RunContext:
    """What accompanies a run while the arms move. By default nothing: no log is written, and the run ends by itself.
    log: closed by the run, with the result in it; one that could not be finished fails the run, and the reason says so.
    live: rings for live viewers. stop: asked once a tick; the judge brakes at once. progress: called at times with the
    completed share of the run, 0 to 1. watchdogs: what has to give signs of life meanwhile, asked once a tick.
    run_observer: whose run_events go into the log, and who learns how the session ended. soft_stop: of a playback,
    along its path. mailbox: where a teleoperation's targets come from."""

    log: RunLog | None = None
    live: Rings | None = None
    stop: StopSignal | None = None
    progress: Progress | None = None
    watchdogs: Sequence[Watchdog] = ()
    run_observer: RunObserver | None = None
    soft_stop: SoftStop | None = None
    mailbox: Mailbox | None = None

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
