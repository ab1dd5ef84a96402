"""What Desk and the Franka Control Interface of a box tell each other: a few bytes that two processes share.

Desk answers HTTPS in a process of its own: one that keeps 1 kHz has no time for a handshake.
"""

import mmap
import os

import numpy as np
from numpy.typing import NDArray

# by Desk: fci, locked (the brakes), off (shut down); by FCI: user_stop (pressed), moving
FLAGS = np.dtype([(name, "u1") for name in ("fci", "locked", "off", "user_stop", "moving")])


def shared_flags() -> tuple[int, NDArray[np.void]]:
    """Make the FLAGS of both boxes (2,), as a box has them that was just switched on; return their descriptor too."""
    descriptor = os.memfd_create("rtstack-desk", 0)
    os.truncate(descriptor, 2 * FLAGS.itemsize)
    flags = flags_at(descriptor)
    flags["locked"] = 1
    return descriptor, flags


def flags_at(descriptor: int) -> NDArray[np.void]:
    """Return the FLAGS (2,) behind a descriptor."""
    return np.frombuffer(mmap.mmap(descriptor, 2 * FLAGS.itemsize), FLAGS)
