"""Curves of one log, or of several over it, in the papers' style: bands by mode, impacts, units at the axes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hal.base.arrays import Array
from rtstack.figures.style import COLOURS, STYLE, mode_band, new_figure
from rtstack.log.analysis.mode_spans import Span
from rtstack.log.analysis.signals import Signal
from rtstack.palette import MODE_STYLES
from rtstack.samples import SIDES, Mode

# Okabe and Ito, each hue as dark as colour-blind eyes need it; the logs over the first one also differ by dashes
OVERLAYS = ("#857b00", "#000000", "#8f2f00", "#c0569e", "#003f78")
DASHES = ((8, 3), (1.5, 2), (7, 2, 1.5, 2), (3.5, 2), (11, 2, 1.5, 2, 1.5, 2))
MOST_LOGS = 1 + len(OVERLAYS)
_WIDTH_IN, _PANE_IN, _AROUND_IN, _LEGEND_IN, _ROW_IN = 7.5, 1.35, 0.9, 0.3, 0.15
_IN_A_ROW = 2  # names of files are long
_LIGHTER, _PALEST = 0.18, 0.75  # of a colour: each further component of one arm, and the last one at most
_WORD_SHARE = 0.1  # of the width: a narrower band has no word
_LABEL_LETTERS = 18  # a pane is as high as so many
_FAINT = "#555555"


@dataclass(frozen=True, slots=True)
class Trace:
    """A signal of a log: t_s (n,) after its first sample, values (n,)."""

    signal: Signal
    t_s: Array
    values: Array


@dataclass(frozen=True, slots=True)
class FigureLog:
    """What a figure shows of a log. offset_s: is added to its time; impacts: (s after its first sample, arm or "")."""

    name: str
    traces: tuple[Trace, ...]
    spans: tuple[Span, ...] = ()
    impacts: tuple[tuple[float, str], ...] = ()
    offset_s: float = 0.0
    sides: tuple[str, ...] = SIDES


@dataclass(frozen=True, slots=True)
class Line:
    """A curve as it is drawn in a pane. place: of its log among all."""

    label: str
    place: int
    colour: str
    style: Any
    width: float
    t_s: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Pane:
    """What shares a vertical axis: its name with its unit, and its lines."""

    label: str
    lines: tuple[Line, ...]


def aligned(logs: Sequence[FigureLog]) -> list[FigureLog]:
    """Return logs moved in time so that their first impacts are those of the first log, where both have one."""
    first = min((t_s for t_s, _ in logs[0].impacts), default=None)
    moved = [logs[0]]
    for log in logs[1:]:
        own = min((t_s for t_s, _ in log.impacts), default=None)
        moved.append(log if first is None or own is None else replace(log, offset_s=first - own))
    return moved


def panes_of(logs: Sequence[FigureLog]) -> list[Pane]:
    """Return what each pane has: the signals of one field, and what they are to follow."""
    followed = {trace.signal.reference: trace.signal.field for trace in logs[0].traces if trace.signal.reference}
    fields: dict[str, list[Signal]] = {}
    for trace in logs[0].traces:
        fields.setdefault(followed.get(trace.signal.name, trace.signal.field), []).append(trace.signal)
    panes = []
    for field, members in fields.items():
        own = [signal for signal in members if signal.field == field] or members
        units = ", ".join(dict.fromkeys(signal.unit for signal in own if signal.unit))
        lines = [_line(log, place, trace, members, own)
                 for place, log in enumerate(logs) for trace in log.traces if trace.signal in members]  # fmt: skip
        panes.append(Pane(own[0].plain + (f", {units}" if units else ""), tuple(lines)))
    return panes


def _line(log: FigureLog, place: int, trace: Trace, members: list[Signal], own: list[Signal]) -> Line:
    signal = trace.signal
    reference = signal not in own
    whose = signal.whose if len(log.sides) > 1 or signal.group not in SIDES else signal.group
    words = [whose, signal.component] + ["reference"] * reference
    colour, style, width = _colour(signal, whose, members), "--" if reference else "-", 1.2
    if place:
        colour, style = OVERLAYS[place - 1], (0, DASHES[place - 1])
        width = 0.5 if reference else 1.8 if signal.group == SIDES[1] else 1.0
        words.append(f"({log.name})")
    return Line(" ".join(filter(None, words)), place, colour, style, width, trace.t_s + log.offset_s, trace.values)


def _colour(signal: Signal, whose: str, members: list[Signal]) -> str:
    """Return the colour of an arm, lighter for each further component of the same field."""
    base = COLOURS[SIDES.index(whose) if whose in SIDES else 2]
    family = [one.component for one in members if one.group == signal.group and one.field == signal.field]
    share = family.index(signal.component) * min(_LIGHTER, _PALEST / len(family))
    red, green, blue = (channel + (1.0 - channel) * share for channel in to_rgb(base))
    return to_hex((red, green, blue))


@mpl.rc_context(STYLE)
def draw(logs: Sequence[FigureLog], start_s: float, end_s: float, title: str = "") -> Figure:
    """Draw logs between two times of the first one, s. There is one signal at least, and at most MOST_LOGS logs."""
    panes = panes_of(logs)
    height = _AROUND_IN + _PANE_IN * len(panes) + (_LEGEND_IN + _ROW_IN * (len(logs) // _IN_A_ROW)) * (len(logs) > 1)
    figure, axes = new_figure(_WIDTH_IN, height, nrows=len(panes), sharex=True)
    for axis, pane in zip(axes[:, 0], panes, strict=True):
        for line in pane.lines:
            first, last = np.searchsorted(line.t_s, [start_s, end_s])
            near = slice(max(0, int(first) - 1), int(last) + 1)  # of the window, and one more on either side
            label = line.label if line.place == 0 else None
            axis.plot(line.t_s[near], line.values[near], color=line.colour, ls=line.style, lw=line.width, label=label)
        axis.set_ylabel(fill(pane.label, _LABEL_LETTERS))
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), fontsize=7, handlelength=1.6)
        axis.set_xlim(start_s, end_s)
        for span in logs[0].spans:
            if span.end_s > start_s and span.start_s < end_s and span.mode is not Mode.IDLE:
                mode_band(axis, max(span.start_s, start_s), min(span.end_s, end_s), span.mode)
        for t_s, _ in logs[0].impacts:
            if start_s <= t_s <= end_s:
                axis.axvline(t_s, color=_FAINT, linestyle=":", linewidth=0.9)
    _say(axes[0, 0], logs[0], start_s, end_s)
    axes[-1, 0].set_xlabel("time, s")
    if len(logs) > 1:
        looks = zip(OVERLAYS, DASHES, logs[1:], strict=False)
        others = [Line2D([], [], color=colour, ls=(0, dash), label=log.name) for colour, dash, log in looks]
        figure.legend(handles=others, loc="outside lower left", ncols=min(len(others), _IN_A_ROW), fontsize=8,
                      handlelength=4, title_fontsize=8, title="over it (right arm thick, references thin)")  # fmt: skip
    if title:
        figure.suptitle(title, fontsize=9, x=0.01, ha="left")
    return figure


def _say(axis: Axes, log: FigureLog, start_s: float, end_s: float) -> None:
    """Write above the first pane what the bands and the lines are."""
    length, free, top = end_s - start_s, start_s, axis.get_xaxis_transform()
    small: dict[str, Any] = {"xycoords": top, "textcoords": "offset points", "fontsize": 7}
    told = [(t_s, f"impact {side}".strip()) for t_s, side in log.impacts if start_s <= t_s <= end_s]
    for t_s, word in told:
        axis.plot([t_s], [1.0], marker="v", markersize=4, color=_FAINT, transform=top, clip_on=False)
        if t_s >= free:
            axis.annotate(word, (t_s, 1.0), xytext=(3, 3), color=_FAINT, **small)
            free = t_s + _WORD_SHARE * length
    for span in log.spans:
        first, last = max(span.start_s, start_s), min(span.end_s, end_s)
        busy = any(first - _WORD_SHARE * length < t_s < last for t_s, _ in told)
        if last - first > _WORD_SHARE * length * (2 if busy else 1) and span.mode is not Mode.IDLE:
            style, ha = MODE_STYLES[span.mode], "right" if busy else "left"
            place = last if busy else first, 1.0
            axis.annotate(style.word, place, xytext=(-2 if busy else 2, 3), ha=ha, color=style.light, **small)
