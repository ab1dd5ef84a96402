"""When the controller was in which mode, from a log."""

from dataclasses import dataclass

import numpy as np

from rtstack.log.reader import Log
from rtstack.samples import Mode


@dataclass(frozen=True, slots=True)
class Span:
    """The time, s after a log's first sample, in which the first arm was in a mode."""

    start_s: float
    end_s: float
    mode: Mode


def mode_spans(log: Log) -> list[Span]:
    """Return when the first arm, left before right, was in which mode."""
    control = log.topic(f"/{log.sides[0]}/control")
    if not len(control):
        return []
    t_s, mode = (control["t_ns"] - log.start_ns) * 1e-9, control["mode"]
    edges = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist()]
    return [
        Span(float(t_s[start]), float(t_s[end]), Mode(int(mode[start])))
        for start, end in zip(edges, [*edges[1:], len(mode) - 1], strict=True)
        if mode[start] in Mode._value2member_map_
    ]
