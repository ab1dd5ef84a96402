"""How far a campaign is, on stderr: a bar where a person looks at it, a line now and then where it is a file."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

LINE_S = 60.0


class CampaignProgress:
    """Counts what is done, and how fast the robot's time goes."""

    def __init__(self, bar: Progress | None) -> None:
        self._bar = bar
        self._task: TaskID | None = None
        self._label = ""
        self._done = self._total = 0
        self._robot_s = 0.0
        self._began_s = self._said_s = time.monotonic()

    def begin(self, label: str, done: int, total: int) -> None:
        """Start counting: so many are done already."""
        self._label, self._done, self._total, self._robot_s = label, done, total, 0.0
        self._began_s = time.monotonic()
        if self._bar is None:
            self._say()
            return
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task = self._bar.add_task(label, total=total, completed=done, pace="")

    def advance(self, robot_s: float) -> None:
        """One more is done."""
        self._done += 1
        self._robot_s += robot_s
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, advance=1, pace=self._pace())
        elif time.monotonic() - self._said_s > LINE_S or self._done == self._total:
            self._say()

    def _pace(self) -> str:
        passed_s = time.monotonic() - self._began_s
        return f"{self._robot_s / passed_s:.1f} x real time" if self._robot_s else ""

    def _say(self) -> None:
        self._said_s = time.monotonic()
        print(f"{self._label}: {self._done} of {self._total} {self._pace()}".rstrip(), file=sys.stderr, flush=True)


@contextmanager
def campaign_progress() -> Iterator[CampaignProgress]:
    """Show progress for the time of a campaign."""
    if not sys.stderr.isatty():
        yield CampaignProgress(None)
        return
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield CampaignProgress(bar)
