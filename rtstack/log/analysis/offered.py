"""Analyses of logs that installed packages offer: curves and numbers, beside those that every log has."""

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.extensions import PLUG_INS_RAISE, ExtensionError, ExtensionPoint, raised
from rtstack.log.analysis.signals import CURVES, Signal
from rtstack.log.reader import Log

ANALYSES: ExtensionPoint[Callable[[Log], Any]] = ExtensionPoint(
    "rtstack.analyses", "analysis", cast(Any, Callable), ours=False
)
MOST = 64  # curves, and numbers, of one analysis
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve that an analysis makes of a log.

    Args:
        name: Lower-case letters, digits and underscores. The review and `rtstack plot` call it ANALYSIS.NAME.
        unit: Unit of the values, "" for none.
        t_ns: Robot's time of each value as in the log's records, ns, in order, (n,).
        values: (n,); not a number where there is none.
    """

    name: str
    unit: str
    t_ns: NDArray[np.int64]
    values: Array


@dataclass(frozen=True, slots=True)
class Number:
    """A number that an analysis makes of a log: its name as a Curve's, its unit, "" for none, its value or None."""

    name: str
    unit: str
    value: float | None


@dataclass(frozen=True, slots=True)
class Analysis:
    """What the function of an analysis returns."""

    curves: tuple[Curve, ...] = ()
    numbers: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True)
class Analysed:
    """What an analysis says of a log. signals: of its curves, in their order; error: why it says nothing, in a line."""

    name: str
    package: str
    signals: tuple[Signal, ...] = ()
    numbers: tuple[Number, ...] = ()
    error: str | None = None


def installed() -> list[tuple[str, str]]:
    """Return name and package of each analysis that is offered."""
    return [(name, " ".join(ANALYSES.package(name))) for name in ANALYSES.names()]


def analyse(
    log: Log, name: str, function: Callable[[Log], Any] | None = None
) -> tuple[Analysed, tuple[Curve, ...]]:  # fmt: skip
    """Return what an analysis says of a log, and its curves. What it raises becomes its `error`.

    Args:
        log: The log.
        name: Of an installed analysis, or how the function shall be called.
        function: The analysis itself, where none is installed under the name.
    """
    package = "" if function else " ".join(ANALYSES.package(name))
    try:
        function = function or ANALYSES.load(name)
        found = _checked(name, function(log))
    except ExtensionError as error:
        return Analysed(name, package, error=str(error)), ()
    except PLUG_INS_RAISE as error:
        return Analysed(name, package, error=f"analysis {name!r}: {raised(error, function)}"), ()
    return Analysed(name, package, tuple(_signal(name, curve) for curve in found.curves), found.numbers), found.curves


def analysed(log: Log) -> Iterable[tuple[Analysed, tuple[Curve, ...]]]:
    """Yield what each installed analysis says of a log."""
    return (analyse(log, name) for name in ANALYSES.names())


def _signal(name: str, curve: Curve) -> Signal:
    whole, plain = f"{name}.{curve.name}", curve.name.replace("_", " ")
    return Signal(whole, f"/analysis/{name}/{curve.name}", name, curve.name, "", curve.unit, 0, plain, name, "")


def _checked(name: str, found: Any) -> Analysis:
    if not isinstance(found, Analysis):
        raise TypeError(f"expected an Analysis, found {type(found).__name__}")
    if name in {topic.group for topic in CURVES.values()} or not _NAME.fullmatch(name):
        raise TypeError(f"an analysis cannot be called {name!r}: give its entry point another name")
    for several in (found.curves, found.numbers):
        names = [one.name for one in several]
        if len(set(names)) < len(names) or len(names) > MOST or not all(map(_NAME.fullmatch, names)):
            raise TypeError(f"expected at most {MOST} names of a-z, 0-9 and _, each once, found {', '.join(names)}")
    curves = [Curve(c.name, str(c.unit), np.asarray(c.t_ns), np.asarray(c.values, np.float64)) for c in found.curves]
    for curve in curves:
        t_ns, shape = curve.t_ns, curve.values.shape
        if t_ns.ndim != 1 or t_ns.shape != shape or t_ns.dtype.kind != "i" or (np.diff(t_ns) < 0).any():
            got = f"t_ns {t_ns.dtype} {t_ns.shape}, values {shape}"
            raise TypeError(f"curve {curve.name}: expected t_ns (n,), int64 in order, and values (n,); found {got}")
    values = [None if n.value is None or not math.isfinite(n.value) else float(n.value) for n in found.numbers]
    numbers = [Number(n.name, str(n.unit), value) for n, value in zip(found.numbers, values, strict=True)]
    return Analysis(tuple(curves), tuple(numbers))
