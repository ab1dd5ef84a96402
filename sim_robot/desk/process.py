"""Desk of the boxes in a process of its own: the one that serves their FCI has no time for a handshake of HTTPS."""

import mmap
import os
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError

PORT = 4443  # a real box has 443, which not every user may listen at
_END_S = 5.0


# by Desk: fci, locked (the brakes), off (shut down); by FCI: user_stop (pressed), moving
FLAGS = np.dtype([(name, "u1") for name in ("fci", "locked", "off", "user_stop", "moving")])


def shared_flags(boxes: int) -> tuple[int, NDArray[np.void]]:
    """Make the FLAGS (n,) of n boxes, as a box has them that was just switched on; return their descriptor too."""
    descriptor = os.memfd_create("rtstack-desk", 0)
    os.truncate(descriptor, boxes * FLAGS.itemsize)
    flags = flags_at(descriptor)
    flags["locked"] = 1
    return descriptor, flags


def flags_at(descriptor: int) -> NDArray[np.void]:
    return np.frombuffer(mmap.mmap(descriptor, 0), FLAGS)


class DeskProcess:
    """A running Desk at each box's address. flags: FLAGS of the boxes (n,)."""

    def __init__(self, addresses: dict[str, str], self_test_due_s: float) -> None:
        """Start it, and wait until it serves. addresses: of the boxes, by arm (left, right). Raises HardwareError."""
        descriptor, self.flags = shared_flags(len(addresses))
        # standard input ends with this process, however it ends
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim_robot.desk.server", str(descriptor), str(PORT), repr(self_test_due_s),
             *(f"{side}={address}" for side, address in addresses.items())],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=(descriptor,), start_new_session=True,
        )  # fmt: skip
        os.close(descriptor)
        assert self._process.stdout is not None
        said = self._process.stdout.readline().strip()
        if said != "serving":
            self.close()
            raise HardwareError(said or "Desk did not start")

    def close(self) -> None:
        try:
            self._process.communicate(timeout=_END_S)  # its standard input ends
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
