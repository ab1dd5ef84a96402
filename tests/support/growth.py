"""How memory, descriptors and files of running processes grow: samples over time, and their slopes."""

import statistics
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

LEFT_BEHIND = ("/dev/shm", tempfile.gettempdir())  # where rings, mailboxes and run folders are


@dataclass(slots=True)
class Growth:
    """A quantity at several moments. at: the moments, in the unit of the slope's denominator."""

    at: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)

    def note(self, at: float, value: float) -> None:
        """Keep a sample."""
        self.at.append(at)
        self.value.append(value)

    def after(self, begin: float) -> list[float]:
        """Return the values since a moment."""
        return [value for at, value in zip(self.at, self.value, strict=True) if at >= begin]

    def ends(self, begin: float) -> tuple[float, float]:
        """Return the medians of the first and the last quarter since a moment."""
        values = self.after(begin)
        part = max(1, len(values) // 4)
        return statistics.median(values[:part]), statistics.median(values[-part:])

    def slope(self, begin: float) -> tuple[float, float] | None:
        """Return the slope since a moment by least squares, and its standard error; None for less than 3 samples."""
        values = np.array(self.after(begin))
        at = np.array(self.at[len(self.at) - len(values) :])
        if len(values) < 3 or not np.ptp(at):
            return None
        (slope, _), covariance = np.polyfit(at, values, 1, cov="unscaled")
        rest = values - np.polyval(np.polyfit(at, values, 1), at)
        return float(slope), float(np.sqrt(covariance[0, 0] * (rest @ rest) / (len(values) - 2)))


def memory_mb(processes: Iterable[psutil.Process]) -> float:
    """Return the memory that processes have for themselves (USS), MB."""
    return sum(_value(each, lambda process: process.memory_full_info().uss) for each in processes) / 1e6


def descriptors(processes: Iterable[psutil.Process]) -> float:
    """Return how many descriptors processes have open."""
    return sum(_value(each, lambda process: process.num_fds()) for each in processes)


def shared_files() -> int:
    """Return how many rings, mailboxes and run folders of this project there are."""
    return sum(1 for folder in LEFT_BEHIND for path in Path(folder).glob("rtstack-*"))


def _value(process: psutil.Process, read) -> float:
    with suppress(psutil.Error):
        return float(read(process))
    return 0.0
