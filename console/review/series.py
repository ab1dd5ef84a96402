"""Curves for a window of time, at most so many points as the window has pixels, and values at a moment.

A bucket of samples, counted from the log's first, becomes its smallest and its largest value, never a mean and never
one in n: an impact of one sample is seen at every zoom.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from console.review.columns import BUCKET, Columns, LogColumns
from rtstack.log.analysis.signals import Signal
from rtstack.log.time_of_day import TimeOfDay, iso
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC

_NS = 1e-9
_ALIGNED = 8  # bytes: what a Float64Array of a browser asks for


@dataclass(frozen=True, slots=True)
class Window:
    """From start_s to end_s after the log's first sample, `width` pixels wide."""

    start_s: float
    end_s: float
    width: int


@dataclass(frozen=True, slots=True)
class Curves:
    """Signals of one topic: t_s (n,), low and high (signals, n). bucket: samples behind each point, 1 for all."""

    topic: str
    names: tuple[str, ...]
    bucket: int
    t_s: NDArray[np.float64]
    low: NDArray[np.float32]
    high: NDArray[np.float32]


def curves(log: LogColumns, signals: Sequence[Signal], window: Window) -> list[Curves]:
    """Return the signals in a window, a sample beyond it on either side, grouped by topic."""
    found = []
    for none, places in _by_topic(signals):
        if (columns := log.of(none.topic)) is None:
            found.append(none)
            continue
        first, last = _rows(columns.t_ns, log.index.start_ns, window)
        bucket = 1 << max(0, (last - first) // max(1, window.width)).bit_length()
        if last - first <= window.width:
            bucket = 1
        first -= first % bucket
        low, high = (
            np.stack([_reduced(columns, place, first, last, bucket, reduce) for place in places])
            for reduce in (np.fmin, np.fmax)
        )
        t_s = np.asarray((columns.t_ns[first:last:bucket] - log.index.start_ns) * _NS, np.float64)
        found.append(replace(none, bucket=bucket, t_s=t_s, low=low, high=high))
    return found


def _by_topic(signals: Sequence[Signal]) -> Iterator[tuple[Curves, list[int]]]:
    """Yield the curves of each topic, without a point, and the columns of its signals."""
    for topic in dict.fromkeys(signal.topic for signal in signals):
        wanted = [signal for signal in signals if signal.topic == topic]
        nothing = np.zeros((len(wanted), 0), np.float32)
        names = tuple(signal.name for signal in wanted)
        yield Curves(topic, names, 1, np.zeros(0), nothing, nothing), [signal.column for signal in wanted]


def difference_curves(
    own: LogColumns, other: LogColumns, signals: Sequence[Signal], window: Window, offset_s: float
) -> list[Curves]:
    """Return the other log's signals minus the own ones, at the own samples in a window; offset_s: added to its time.

    Between two samples of the other log its signals are on a straight line; outside of it there is no difference.
    """
    found = []
    for none, places in _by_topic(signals):
        columns, others = own.of(none.topic), other.of(none.topic)
        if columns is None or others is None:
            found.append(none)
            continue
        first, last = _rows(columns.t_ns, own.index.start_ns, window)
        t_s = np.asarray((columns.t_ns[first:last] - own.index.start_ns) * _NS, np.float64)
        other_s = (others.t_ns - other.index.start_ns) * _NS + offset_s
        theirs = [np.interp(t_s, other_s, others.values[place], left=np.nan, right=np.nan) for place in places]
        values = (np.stack(theirs) - columns.values[places, first:last]).astype(np.float32)
        bucket = max(1, -(-(last - first) // max(1, window.width)))
        starts = np.arange(0, last - first, bucket)
        low, high = np.fmin.reduceat(values, starts, axis=1), np.fmax.reduceat(values, starts, axis=1)
        found.append(replace(none, bucket=bucket, t_s=t_s[::bucket], low=low, high=high))
    return found


def _rows(t_ns: NDArray[np.int64], start_ns: int, window: Window) -> tuple[int, int]:
    """First row and the row behind the last one of a window, one more on either side."""
    first, last = _places(t_ns, start_ns, window.start_s, window.end_s)
    return max(0, first - 1), max(1, min(len(t_ns), last + 1))


def _places(t_ns: NDArray[np.int64], zero_ns: int, start_s: float, end_s: float) -> tuple[int, int]:
    """First row at or after start_s and the one at or after end_s. Whole numbers: else numpy copies all times."""
    edges_ns = zero_ns + np.ceil(np.array([start_s, end_s]) * 1e9).astype(np.int64)
    first, last = np.searchsorted(t_ns, edges_ns, side="left")
    return int(first), int(last)


def _reduced(
    columns: Columns, column: int, first: int, last: int, bucket: int, reduce: np.ufunc
) -> NDArray[np.float32]:
    if bucket == 1:
        return np.asarray(columns.values[column, first:last])
    if bucket < BUCKET:
        return reduce.reduceat(columns.values[column, first:last], np.arange(0, last - first, bucket))
    level = (columns.low if reduce is np.fmin else columns.high)[column]
    part = level[first // BUCKET : -(-last // BUCKET)]
    return reduce.reduceat(part, np.arange(0, len(part), bucket // BUCKET))


def packed(found: Sequence[Curves]) -> bytes:
    """Return curves in the binary form that console.routes.logs.series describes."""
    header = [{"topic": c.topic, "signals": c.names, "bucket": c.bucket, "points": len(c.t_s)} for c in found]
    text = json.dumps(header).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNED)
    parts = [np.uint32(len(text)).tobytes(), text]
    for one in found:
        parts.append(one.t_s.astype("<f8").tobytes())
        for row in range(len(one.names)):
            for values in (one.low[row],) if one.bucket == 1 else (one.low[row], one.high[row]):
                data = values.astype("<f4").tobytes()
                parts.append(data + bytes(-len(data) % _ALIGNED))
    return b"".join(parts)


@dataclass(frozen=True, slots=True)
class Moment:
    """What a log says about a moment: t_s of its sample; values by signal, q (arms, 7) rad, of the arms at these sides,
    and object (7,) m, wxyz; None where the log has none, or before its first one."""

    t_s: float
    values: dict[str, float | None]
    sides: tuple[str, ...]
    q: NDArray[np.float64] | None
    object: NDArray[np.float64] | None


def moment(log: LogColumns, signals: Sequence[Signal], t_s: float) -> Moment:
    """Return the newest samples at t_s."""
    index = log.index
    t_ns = index.start_ns + round(t_s * 1e9)
    blocks: dict[str, tuple[int, NDArray[np.float32]]] = {}
    for topic in {signal.topic for signal in signals} | {*ARM_TOPICS, OBJECT_TOPIC}:
        columns = log.of(topic)
        row = -1 if columns is None else int(np.searchsorted(columns.t_ns, t_ns, side="right")) - 1
        if columns is not None and row >= 0:
            blocks[topic] = int(columns.t_ns[row]), columns.values[:, row]
    values: dict[str, float | None] = {signal.name: None for signal in signals}
    for signal in signals:
        if signal.topic in blocks and np.isfinite(value := blocks[signal.topic][1][signal.column]):
            values[signal.name] = float(value)
    arms = [blocks.get(f"/{side}/arm") for side in index.sides]
    pose = blocks.get(OBJECT_TOPIC)
    newest = max((t for t, _ in blocks.values()), default=t_ns)
    return Moment(
        t_s=(newest - index.start_ns) * _NS,
        values=values,
        sides=index.sides,
        q=None if None in arms or not arms else np.array([arm[1][:7] for arm in arms if arm is not None], np.float64),
        object=None if pose is None else pose[1][:7].astype(np.float64),
    )


@dataclass(frozen=True, slots=True)
class Tabled:
    """A log in a table: columns, prefix of its signals' names, what is added to its time, s, and its times' UTC."""

    log: LogColumns
    prefix: str = ""
    offset_s: float = 0.0
    time: TimeOfDay | None = None


def csv_lines(logs: Sequence[Tabled], signals: Sequence[Signal], start_s: float, end_s: float) -> Iterator[str]:
    """Yield a table of every sample in a window: t_s, the first log's UTC, and each log's signals, empty for none."""
    yield ",".join(["t_s", "utc", *(f"{log.prefix}{signal.name}" for log in logs for signal in signals)]) + "\n"
    cells = [(_rows_in_window(log, signal.topic, start_s, end_s), signal) for log in logs for signal in signals]
    times = np.unique(np.concatenate([rows[1] for rows, _ in cells if rows is not None] or [np.zeros(0, np.int64)]))
    for part in range(0, len(times), 10_000):  # pieces: a whole log is a hundred megabytes of text
        t_ns = times[part : part + 10_000]
        table = np.full((len(t_ns), len(cells)), "", object)
        for number, (rows, signal) in enumerate(cells):
            if rows is None or not len(rows[1]):
                continue
            columns, own_ns, first = rows
            places = np.searchsorted(own_ns, t_ns)
            here = own_ns[np.minimum(places, len(own_ns) - 1)] == t_ns
            values = columns.values[signal.column, first + places[here]]
            table[here, number] = [f"{value:.8g}" for value in values.tolist()]
        time, start_ns = logs[0].time, logs[0].log.index.start_ns
        utc = [""] * len(t_ns) if time is None else map(iso, time.unix_ns(start_ns + t_ns).tolist())
        rows = zip(t_ns.tolist(), utc, table, strict=True)
        yield "".join(f"{t * _NS:.6f},{when},{','.join(row)}\n" for t, when, row in rows)


def _rows_in_window(
    table: Tabled, topic: str, start_s: float, end_s: float
) -> tuple[Columns, NDArray[np.int64], int] | None:
    """Return a topic's samples in a window: columns, times (n,), ns after the table's zero, and the first one's row."""
    columns = table.log.of(topic)
    if columns is None:
        return None
    zero_ns = table.log.index.start_ns - round(table.offset_s * 1e9)
    first, last = _places(columns.t_ns, zero_ns, start_s, end_s)
    return columns, columns.t_ns[first:last] - zero_ns, first
