"""What an operator asks of the loop: the block of words that the mailbox carries, as one record."""

from enum import IntEnum

import numpy as np


class Release(IntEnum):
    """Why the clutch is not held."""

    NOT_YET = 0  # it was not held since the session began
    RELEASED = 1  # by the operator
    LOST = 2  # the page was hidden, closed, or lost the keyboard focus


# clutch_ns: host's time.monotonic_ns() of the last sign of life of a clutch that is held, 0 while it is not; release:
# Release; finish: not 0 to end the session; speed m/s; stiffness N/m; pose T_world_ee of (left, right): m, wxyz
TARGET = np.dtype(
    [
        ("job", "i8"),
        ("clutch_ns", "i8"),
        ("release", "i8"),
        ("finish", "i8"),
        ("speed", "f8"),
        ("stiffness", "f8"),
        ("pose", "f8", (2, 7)),
    ]
)
