"""What a figure shows of a log on disk: the signals' samples, the modes and the impacts."""

import math
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from numpy.typing import NDArray

from rtstack.figures.log_figure import FigureLog, Trace
from rtstack.log.analysis.derived import DERIVED_TOPICS, derived
from rtstack.log.analysis.mode_spans import mode_spans
from rtstack.log.analysis.offered import analyse
from rtstack.log.analysis.signals import Signal, signals
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.samples import SIDES

_NS = 1e-9
_AROUND_S = (0.2, 0.3)  # before and after the first impact: the papers' figures


def figure_log(path: Path, wanted: Sequence[Signal], analyses: Sequence[str] = ()) -> FigureLog:
    """Read a log; of the signals those of arms that it has. analyses: ANALYSIS or ANALYSIS.CURVE of an installed
    package. Raises LogError with one line.
    """
    log = read_log(path)
    wanted = [signal for signal in wanted if signal.group not in SIDES or signal.group in log.sides]
    records = {
        topic: derived(log, topic) if topic in DERIVED_TOPICS else log.topic(topic)
        for topic in dict.fromkeys(signal.topic for signal in wanted)
    }
    traces = *(_trace(signal, records[signal.topic], log.start_ns) for signal in wanted), *_analysed(log, analyses)
    name = os.fsencode(path.stem).decode(errors="replace")  # no figure takes other text
    return FigureLog(name, traces, tuple(mode_spans(log)), impacts_of(log), sides=log.sides)


def impacts_of(log: Log) -> tuple[tuple[float, str], ...]:
    """Return when each arm had its first impact, s; of a demonstration, which waits for none, the one it found."""
    told = [((e.t_ns - log.start_ns) * _NS, arm_of(e.text)) for e in log.events if e.name == "impact"]
    found = log.metadata.get("result", {}).get("detected_impact_time_s", "null")
    return tuple(told) if told or found == "null" else ((float(found), ""),)


def with_references(wanted: Sequence[Signal]) -> list[Signal]:
    """Return signals, and behind them what they are to follow, each once."""
    return list(dict.fromkeys([*wanted, *(signals()[signal.reference] for signal in wanted if signal.reference)]))


def window(log: FigureLog, start_s: float | None, end_s: float | None, impact: bool) -> tuple[float, float]:
    """Return from when to when a figure shows a log, s; impact: around its first impact. Raises LogError."""
    ends = [float(trace.t_s[-1]) for trace in log.traces if len(trace.t_s)]
    if not ends:
        raise LogError(f"{log.name}: it has no samples of these signals")
    first, last = 0.0, max(ends)
    if impact:
        if not log.impacts:
            raise LogError(f"{log.name}: there was no impact in it; give --from and --to")
        hit_s = min(t_s for t_s, _ in log.impacts)
        first, last = max(first, hit_s - _AROUND_S[0]), min(last, hit_s + _AROUND_S[1])
    first, last = first if start_s is None else start_s, last if end_s is None else end_s
    if not first < last:
        raise LogError(f"--from {first:g} has to be before --to {last:g}")
    return first, last


def arm_of(text: str) -> str:
    """Return which arm an impact's event names, an empty word for both."""
    named = [side for side in SIDES if re.search(rf"\b{side}\b", text)]
    return named[0] if len(named) == 1 else ""


def _analysed(log: Log, words: Sequence[str]) -> Iterator[Trace]:
    for name in dict.fromkeys(word.partition(".")[0] for word in words):
        found, curves = analyse(log, name)
        known = {signal.name: (signal, curve) for signal, curve in zip(found.signals, curves, strict=True)}
        lacking = [word for word in words if word.startswith(f"{name}.") and word not in known]
        if found.error is not None:
            raise LogError(found.error)
        if lacking:
            raise LogError(f"unknown signal {lacking[0]!r}: the analysis gives {', '.join(known) or 'no curve'}")
        for signal, curve in known.values():
            if name in words or signal.name in words:
                yield Trace(signal, (curve.t_ns - log.start_ns) * _NS, curve.values)


def _trace(signal: Signal, records: NDArray, start_ns: int) -> Trace:
    components = [one.component for one in signals().values() if (one.group, one.field) == (signal.group, signal.field)]
    values = records[signal.field]
    values = values.reshape(len(values), math.prod(values.shape[1:]))
    return Trace(signal, (records["t_ns"] - start_ns) * _NS, values[:, components.index(signal.component)])
