"""What functions of arrays take and return; a docstring gives shape, unit and frame."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
"""An array of floats; the docstring of what takes or returns it gives shape, unit and frame."""
Seven = tuple[float, float, float, float, float, float, float]  # a number a joint


def seven(values: Any) -> Seven:
    """Return the numbers of the joints, (7,), as a tuple of Python's own floats."""
    a, b, c, d, e, f, g = (float(value) for value in values)
    return a, b, c, d, e, f, g
