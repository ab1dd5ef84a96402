"""Which curves a log has: every number of every record, with its name, unit and place in the tree.

A name is `side.field.component`, as in an address of the review page: left.tau_J.4, right.force_norm. Joints count from
1. What is derived comes first, then what is recorded.
"""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rtstack.log.analysis.derived import DERIVED_TOPICS
from rtstack.log.errors import LogError
from rtstack.samples import SIDES
from rtstack.topics import PLOTTED_TOPICS, TOPICS, unit_of

CURVES = DERIVED_TOPICS | {name: TOPICS[name] for name in PLOTTED_TOPICS}
_OF_BOTH = ("force_norm", "pair_verdict", "pair_reason", "pair_margin")  # recorded with each arm
DEFAULT = ("left.pad_force", "right.pad_force", "left.force_norm", "left.pad_velocity.vy", "right.pad_velocity.vy")


@dataclass(frozen=True, slots=True)
class Signal:
    """One curve: column `column` of `topic`, counted over its fields and their components.

    plain: the field in words; whose: the arm's or both arms'; reference: the name of the signal that this one is to
    follow, or empty.
    """

    name: str
    topic: str
    group: str
    field: str
    component: str
    unit: str
    column: int
    plain: str
    whose: str
    reference: str


@cache
def topic_signals(topic: str) -> tuple[Signal, ...]:
    """Return the signals of a topic, in the order of its columns."""
    group = CURVES[topic].group
    signals: list[Signal] = []
    for field in CURVES[topic].plotted_fields:
        for component in field.axes or ("",):
            end = f".{component}" if component else ""
            signals.append(Signal(
                f"{group}.{field.name}{end}", topic, group, field.name, component, unit_of(field, component),
                len(signals), field.plain or field.name.replace("_", " "),
                "both arms" if field.name in _OF_BOTH else group,
                f"{group}.{field.reference}{end}" if field.reference else "",
            ))  # fmt: skip
    return tuple(signals)


@cache
def signals() -> dict[str, Signal]:
    """Return all signals by name. Topics of one group have no field in common: see rtstack.topics."""
    return {signal.name: signal for topic in CURVES for signal in topic_signals(topic)}


def matching(words: Sequence[str]) -> list[Signal]:
    """Return the signals that words name: a whole name, or a part between dots: left.tau_J, pad_force, tau_J.4.

    Raises LogError for a word that names none.
    """
    found: dict[str, Signal] = {}
    for word in words:
        inside = f".{word}."
        hits = [signal for signal in signals().values() if inside in f".{signal.name}."]
        if not hits:
            names = [*signals(), *{signal.field for signal in signals().values()}]
            near = difflib.get_close_matches(word, names, 3, 0.5)
            meant = f", did you mean {' or '.join(near)}?" if near else "."
            raise LogError(f"unknown signal {word!r}{meant} There are: {_fields()}")
        found |= {signal.name: signal for signal in hits}
    return list(found.values())


def _fields() -> str:
    """Return all fields in one line, by group: of left and right alike."""
    groups: dict[str, dict[str, None]] = {}
    for signal in signals().values():
        group = "left, right" if signal.group in SIDES else signal.group
        groups.setdefault(group, {})[signal.field] = None
    return "; ".join(f"{group}: {', '.join(fields)}" for group, fields in groups.items())


def column_block(topic: str, records: NDArray) -> NDArray[np.float32]:
    """Return the signals of a topic's records as columns, (signals, n): single precision, seven digits, is enough to
    look at, and halves what has to be read."""
    parts = []
    for field in CURVES[topic].plotted_fields:
        parts.append(records[field.name].reshape(len(records), -1)[:, : max(1, len(field.axes))].T)
    return np.concatenate(parts).astype(np.float32)
