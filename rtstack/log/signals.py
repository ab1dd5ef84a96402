"""Which curves a log has: every number of every record, with its name, unit and place in the tree.

A name is `side.field.component`, as in an address of the review page: left.tau_J.4, right.force_norm,
timing.period_us, object.position.z. Joints count from 1.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rtstack.topics import PLOTTED_TOPICS, TOPICS

_SYMBOLS = {"us": "µs", "rad/s^2": "rad/s²"}  # units of the table, which is ASCII, as a page shows them


@dataclass(frozen=True, slots=True)
class Signal:
    """One curve: column `column` of the columns of `topic`, counted over its fields and their components."""

    name: str
    topic: str
    group: str
    field: str
    component: str
    unit: str
    column: int


@cache
def topic_signals(topic: str) -> tuple[Signal, ...]:
    """Return the signals of a topic, in the order of its columns."""
    group = TOPICS[topic].group
    signals: list[Signal] = []
    for field in TOPICS[topic].plotted_fields:
        unit = _SYMBOLS.get(field.unit, field.unit)
        for component in field.axes or ("",):
            name = f"{group}.{field.name}.{component}" if component else f"{group}.{field.name}"
            signals.append(Signal(name, topic, group, field.name, component, unit, len(signals)))
    return tuple(signals)


@cache
def signals() -> dict[str, Signal]:
    """Return all signals by name. Topics of one group have no field in common: see rtstack.topics."""
    return {signal.name: signal for topic in PLOTTED_TOPICS for signal in topic_signals(topic)}


def column_block(topic: str, records: NDArray) -> NDArray[np.float32]:
    """Return the signals of a topic's records as columns, (signals, n): single precision, seven digits, is enough to
    look at, and halves what has to be read."""
    parts = []
    for field in TOPICS[topic].plotted_fields:
        values = records[field.name].reshape(len(records), -1)
        parts.append(values[:, : max(1, len(field.axes))].T)
    return np.concatenate(parts).astype(np.float32)
