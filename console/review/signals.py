"""Which curves a log has: every number of every record, with its name, unit and place in the tree.

A name is `side.field.component`, as in an address of the review page: left.tau_J.4, right.force_norm,
timing.period_us, object.position.z. Joints count from 1.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rtstack.samples import TOPICS

_JOINTS = tuple(str(number) for number in range(1, 8))
_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_MATRIX = tuple(name for row in "123" for name in (f"r{row}1", f"r{row}2", f"r{row}3", "xyz"[int(row) - 1]))

# field -> components (in the order of the record), unit; what is not here is one number without a unit
_FIELDS: dict[str, tuple[tuple[str, ...], str]] = {
    "q": (_JOINTS, "rad"),
    "dq": (_JOINTS, "rad/s"),
    "tau_J": (_JOINTS, "Nm"),
    "tau_J_d": (_JOINTS, "Nm"),
    "dtau_J": (_JOINTS, "Nm/s"),
    "theta": (_JOINTS, "rad"),
    "dtheta": (_JOINTS, "rad/s"),
    "tau_ext_hat_filtered": (_JOINTS, "Nm"),
    "tau_desired": (_JOINTS, "Nm"),
    "tau_applied": (_JOINTS, "Nm"),
    "momentum_residual": (_JOINTS, "Nm"),
    "residual_rate": (_JOINTS, "Nm/s"),
    "O_T_EE": (_MATRIX, "m"),
    "O_F_ext_hat_K": (_WRENCH, "N, Nm"),
    "wrench_desired": (_WRENCH, "N, Nm"),
    "wrench_ff": (_WRENCH, "N, Nm"),
    "twist_ref": (_TWIST, "m/s, rad/s"),
    "pose_ref": (_POSE, "m"),
    "beta": ((), "rad/s²"),
    "period_us": ((), "µs"),
    "compute_us": ((), "µs"),
    "lateness_us": ((), "µs"),
    "pair_skew_us": ((), "µs"),
    "position": (("x", "y", "z"), "m"),
    "orientation_wxyz": (("w", "x", "y", "z"), ""),
}
_LEFT_OUT = frozenset({"t_ns", "current_errors", "seen"})  # the time, a bit mask, and a flag: no curves
PLOTTED_TOPICS = tuple(topic for topic in TOPICS if topic != "/events")


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
    group = topic.split("/")[1]
    signals: list[Signal] = []
    for field in TOPICS[topic].names or ():
        if field in _LEFT_OUT:
            continue
        components, unit = _FIELDS.get(field, ((), ""))
        for component in components or ("",):
            name = f"{group}.{field}.{component}" if component else f"{group}.{field}"
            signals.append(Signal(name, topic, group, field, component, unit, len(signals)))
    return tuple(signals)


@cache
def signals() -> dict[str, Signal]:
    """Return all signals by name. Both topics of an arm share the arm's group: their fields have different names."""
    return {signal.name: signal for topic in PLOTTED_TOPICS for signal in topic_signals(topic)}


def column_block(topic: str, records: NDArray) -> NDArray[np.float32]:
    """Return the signals of a topic's records as columns, (signals, n): single precision, seven digits, is enough to
    look at, and halves what has to be read."""
    parts = []
    for field in TOPICS[topic].names or ():
        if field in _LEFT_OUT:
            continue
        values = records[field].reshape(len(records), -1)
        components, _ = _FIELDS.get(field, ((), ""))
        parts.append(values[:, : max(1, len(components))].T)
    return np.concatenate(parts).astype(np.float32)


assert set(_FIELDS) <= {name for dtype in TOPICS.values() for name in dtype.names or ()}, "every field exists"
