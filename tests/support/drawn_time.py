"""The time that a simulated camera draws into its pictures."""

import numpy as np
from numpy.typing import NDArray

from rtstack.cameras.source import STAMP_BITS, STAMP_NS, STAMP_PX


def read_time(picture: NDArray[np.uint8]) -> int:
    """Return the time that is drawn into a picture, ns."""
    squares = picture[:STAMP_PX, : STAMP_PX * STAMP_BITS].mean(axis=(0, 2)).reshape(STAMP_BITS, STAMP_PX).mean(axis=1)
    return int("".join("1" if square > 127.5 else "0" for square in squares), 2) * STAMP_NS
