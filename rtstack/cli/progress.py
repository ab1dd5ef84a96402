"""How far a command is, on stderr: a bar with the time left where it is a terminal, now and then a line elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINE_S = 20.0  # between two lines: what takes less says nothing


@contextmanager
def progress_bar(label: str, shown: bool) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes the done fraction, and shows it where that is wanted."""
    if not shown:
        yield lambda fraction: None
        return
    if not sys.stderr.isatty():
        yield Lines(label)
        return
    from rich import progress as rich
    from rich.console import Console

    columns = rich.Progress.get_default_columns()[:-1]  # description, bar, share
    columns += rich.TimeElapsedColumn(), rich.TextColumn("left"), rich.TimeRemainingColumn()
    with rich.Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)


class Lines:
    """Says how far a command is in a line of its own, every LINE_S. clock: gives s."""

    def __init__(self, label: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._label, self._clock = label, clock
        self._began: tuple[float, float] | None = None
        self._said_s = 0.0

    def __call__(self, fraction: float) -> None:
        """Take the done fraction."""
        now_s = self._clock()
        if self._began is None:  # what is compiled before does not count
            self._began, self._said_s = (now_s, fraction), now_s
        began_s, from_fraction = self._began
        if now_s - self._said_s < LINE_S or fraction <= from_fraction:
            return
        self._said_s = now_s
        left_s = (now_s - began_s) * (1.0 - fraction) / (fraction - from_fraction)
        print(f"rtstack: {self._label}: {100 * fraction:.0f} %, {left_s:.0f} s left", file=sys.stderr, flush=True)
