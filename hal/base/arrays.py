"""What functions of arrays take and return; a docstring gives shape, unit and frame."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
"""An array of floats; the docstring of what takes or returns it gives shape, unit and frame."""
Seven = tuple[float, float, float, float, float, float, float]  # a number a joint

# For each kind that is asked for: the kinds of numpy that are accepted, and its name in a message
_KINDS = {"f": ("iuf", "numbers"), "i": ("iu", "whole numbers (int64)"), "b": ("b", "true or false")}
_MOST = 1_000_000_000  # 8 GB


def numbers(value: Any, name: str, shape: tuple[int | None, ...], dtype: type = float, finite: bool = True) -> Array:
    """Return an argument as a contiguous array of float, np.int64 or bool; the argument itself where it is one already.

    name: for the message; shape: with None for any length; finite: whether infinite and NaN are refused. Raises
    ValueError with one line: the name, what was expected, what was found.
    """
    kinds, words = _KINDS[np.dtype(dtype).kind]
    try:
        array = np.asarray(value.filled(np.nan) if isinstance(value, np.ma.MaskedArray) else value)
    except (ValueError, TypeError, OverflowError):  # rows of different lengths
        raise ValueError(f"{name}: expected {words}, found {type(value).__name__}") from None
    if array.dtype.kind not in kinds or (kinds == "iu" and not np.can_cast(array.dtype, np.int64)):
        raise ValueError(f"{name}: expected {words}, found {array.dtype}")
    if array.size > _MOST:
        raise ValueError(f"{name}: expected at most {_MOST:,} numbers, found {array.size:,}")
    if len(shape) != array.ndim or any(want not in (None, has) for want, has in zip(shape, array.shape, strict=True)):
        expected = str(shape).replace("None", "any")
        raise ValueError(f"{name}: expected shape {expected}, found {array.shape}")
    with np.errstate(over="ignore"):  # of longer floats
        array = np.require(array, dtype, ("C", "A", "W", "E"))
    if finite and not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, found {array[~np.isfinite(array)][0]}")
    return array


def seven(values: Any) -> Seven:
    """Return the numbers of the joints, (7,), as a tuple of Python's own floats."""
    a, b, c, d, e, f, g = (float(value) for value in values)
    return a, b, c, d, e, f, g
