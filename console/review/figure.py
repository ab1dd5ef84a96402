"""What the review shows as a figure in the papers' style: drawn from the columns, as `rtstack plot` draws."""

import math
import threading
from collections.abc import Sequence
from io import BytesIO

import numpy as np

from console.refused import Refused
from console.review.logs import ReadLog
from console.review.series import Curves, Window, curves, difference_curves
from rtstack.figures.log_data import arm_of
from rtstack.figures.log_figure import MOST_LOGS, FigureLog, Span, Trace, draw
from rtstack.figures.style import save
from rtstack.log.analysis.signals import Signal
from rtstack.samples import Mode

MEDIA_TYPES = {"pdf": "application/pdf", "svg": "image/svg+xml", "png": "image/png"}
_POINTS = 4000  # buckets over the width: more than any printer shows
_DRAWING = threading.Lock()  # Matplotlib's settings are the process', not a thread's


def overlays_of(text: str) -> list[tuple[str, float]]:
    """Return ids and offsets, s, of `ID:OFFSET,...`. Raises Refused."""
    found = []
    for word in filter(None, text.split(",")):
        log_id, _, offset = word.partition(":")
        try:
            offset_s = float(offset or 0.0)
        except ValueError:
            offset_s = math.nan
        if not abs(offset_s) <= 1e9:
            raise Refused(422, f"others: {word[:80]} is not ID:OFFSET, with an offset of at most 1e9 s")
        found.append((log_id, offset_s))
    if len(found) >= MOST_LOGS:
        raise Refused(422, f"others: {len(found)} are too many, at most {MOST_LOGS - 1}")
    return found


def drawn_logs(
    own: ReadLog, overlays: Sequence[tuple[ReadLog, float]], wanted: Sequence[Signal], start_s: float, end_s: float,
    difference: bool,
) -> list[FigureLog]:  # fmt: skip
    """Return what a figure of a log and of others over it shows, or of the others' difference to it."""
    window = Window(start_s, end_s, _POINTS)
    told = next(iter(own.index.modes.values()), [])  # of the first arm
    spans = tuple(Span(from_s, to_s, Mode[mode]) for from_s, to_s, mode in told if mode in Mode.__members__)
    impacts = tuple((mark.t_s, arm_of(mark.text)) for mark in own.index.events if mark.name == "impact")
    name = own.entry.path.stem
    found = []
    if not difference:
        found.append(FigureLog(name, _traces(curves(own, wanted, window), wanted), spans, impacts))
    for other, offset_s in overlays:
        title, moved = other.entry.path.stem, Window(start_s - offset_s, end_s - offset_s, _POINTS)
        if difference:
            made = _traces(difference_curves(own, other, wanted, window, offset_s), wanted)
            found.append(FigureLog(f"{title} - {name}", made, spans, impacts))
        else:
            found.append(FigureLog(title, _traces(curves(other, wanted, moved), wanted), offset_s=offset_s))
    return found


def figure_file(logs: Sequence[FigureLog], start_s: float, end_s: float, title: str, form: str) -> bytes:
    """Return the figure's file. form: of MEDIA_TYPES."""
    target = BytesIO()
    with _DRAWING:
        save(draw(logs, start_s, end_s, title), target, form)
    return target.getvalue()


def _traces(found: Sequence[Curves], wanted: Sequence[Signal]) -> tuple[Trace, ...]:
    """Return curves as lines: of a bucket its smallest and its largest value."""
    known: dict[str, Signal] = {signal.name: signal for signal in wanted}
    traces = []
    for part in found:
        t_s = part.t_s if part.bucket == 1 else np.repeat(part.t_s, 2)
        for row, name in enumerate(part.names):
            both = np.stack([part.low[row], part.high[row]], axis=1).ravel()
            traces.append(Trace(known[name], t_s, part.low[row] if part.bucket == 1 else both))
    return tuple(sorted(traces, key=lambda trace: wanted.index(trace.signal)))  # as the page has them
