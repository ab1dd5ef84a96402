"""Which logs go: reviewed ones, by age, then the oldest ones until the rest fits into its budget. No other, ever."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rtstack.log.errors import LogError
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.remarks import may_go, sidecars

DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Pruning:
    """going: what goes, oldest first. kept_bytes: of all logs that stay; over_bytes: by how much they miss the budget;
    unreviewed_bytes: of those that stay because they were not reviewed, or are references."""

    going: tuple[LogEntry, ...]
    kept_bytes: int
    over_bytes: int
    unreviewed_bytes: int


def plan_pruning(
    entries: Iterable[LogEntry], now_s: float, older_than_s: float | None, budget_bytes: float | None
) -> Pruning:
    """Return what has to go. None: no limit of that kind. Changes nothing."""
    oldest_first = sorted(entries, key=lambda entry: entry.modified_s)
    total = sum(entry.size_bytes for entry in oldest_first)
    reviewed = [entry for entry in oldest_first if may_go(entry.path)]
    going: list[LogEntry] = []
    for entry in reviewed:
        old = older_than_s is not None and now_s - entry.modified_s > older_than_s
        if old or (budget_bytes is not None and total > budget_bytes):
            going.append(entry)
            total -= entry.size_bytes
    over = 0 if budget_bytes is None else max(0, round(total - budget_bytes))
    kept_reviewed = sum(entry.size_bytes for entry in reviewed) - sum(entry.size_bytes for entry in going)
    return Pruning(tuple(going), total, over, total - kept_reviewed)


def prune(pruning: Pruning) -> Iterator[LogEntry]:
    """Remove what goes, with what stands beside it; yield each log that is gone.

    A log that has changed since, or whose mark was taken back, stays. Raises LogError.
    """
    for entry in pruning.going:
        try:
            status = entry.path.stat()
            known = status.st_size, status.st_mtime_ns * 1e-9
            if known != (entry.size_bytes, entry.modified_s) or not may_go(entry.path):
                continue
            beside = sidecars(entry.path)
            entry.path.unlink()
            for path in beside:
                path.unlink(missing_ok=True)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise LogError(f"{entry.path}: cannot be removed: {error.strerror}") from None
        yield entry
