"""How far a campaign is: on stderr, a bar in a terminal and lines in a file; and in its folder's progress.json."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from hal.base.files import write_whole

PROGRESS = "progress.json"
LINE_S = 60.0
FILE_S = 0.5  # between two writes of the file, but for the beginning and the end of a stage


class Progress:
    """Counts what is done, and the robot's time. out: the campaign's folder; told: called with what a person reads."""

    def __init__(self, out: Path, bar: Bar | None = None, told: Callable[[str], None] = lambda text: None) -> None:
        self._file = out / PROGRESS
        self._bar = bar
        self._task: TaskID | None = None
        self._label = ""
        self._done = self._total = self._failed = 0
        self._robot_s = 0.0
        self._began_s = self._said_s = time.monotonic()
        self._written_s = -FILE_S
        self._told = self._next = ""
        self._tell = told

    def begin(self, label: str, done: int, total: int) -> None:
        """Start counting a stage: so many are done already."""
        self._label, self._done, self._total, self._failed, self._robot_s = label, done, total, 0, 0.0
        self._began_s = time.monotonic()
        self._write()
        if self._bar is None:
            self._say()
            return
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task = self._bar.add_task(label, total=total, completed=done, pace="")

    def advance(self, robot_s: float = 0.0, done: int = 1, failed: int = 0) -> None:
        """So many more are done, of so many seconds of the robot, and so many could not be run."""
        self._done += done
        self._failed += failed
        self._robot_s += robot_s
        ended = self._done + self._failed >= self._total
        if ended or time.monotonic() - self._written_s >= FILE_S:
            self._write()
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, advance=done + failed, pace=self._pace())
        elif ended or time.monotonic() - self._said_s > LINE_S:
            self._say()

    def tell(self, text: str) -> None:
        """Show what a person is to do or to know, one line that stays until the next one; "" for none."""
        if text == self._told:
            return
        if text and not self._told:  # not each millimetre of a deviation
            self._tell(text)
        self._told = text
        self._write()
        if text and self._bar is not None:
            self._bar.console.print(text)
        elif text:
            print(text, file=sys.stderr, flush=True)

    def say_next(self, text: str) -> None:
        """Say what is run after what runs now, "" for nothing; a person at the arms sees it."""
        self._next = text
        self._write()

    def close(self) -> None:
        if self._label:
            self._write()

    def _pace(self) -> str:
        passed_s = time.monotonic() - self._began_s
        return f"{self._robot_s / passed_s:.1f} x real time" if self._robot_s else ""

    def _say(self) -> None:
        self._said_s = time.monotonic()
        done = self._done + self._failed
        print(f"{self._label}: {done} of {self._total} {self._pace()}".rstrip(), file=sys.stderr, flush=True)

    def _write(self) -> None:
        self._written_s = time.monotonic()
        values = {"stage": self._label, "done": self._done, "failed": self._failed, "total": self._total}
        values |= {key: text for key, text in (("says", self._told), ("next", self._next)) if text}
        write_whole(self._file, json.dumps(values) + "\n", durable=False)


@contextmanager
def campaign_progress(out: Path, told: Callable[[str], None] = lambda text: None) -> Iterator[Progress]:
    """Show progress for the time of a campaign. told: see Progress."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    shown = Bar(*columns, console=Console(stderr=True), transient=True) if sys.stderr.isatty() else None
    with shown or nullcontext(), closing(Progress(out, shown, told)) as progress:
        yield progress
