"""Desk of both boxes in a process of its own, as the process sees it that serves their FCI."""

import os
import subprocess
import sys

from hal.errors import HardwareError
from sim_robot.desk.flags import shared_flags

PORT = 4443  # a real box has 443, which not every user may listen at
_END_S = 5.0


class DeskProcess:
    """A running Desk at both addresses. flags: FLAGS of both boxes (2,)."""

    def __init__(self, addresses: tuple[str, str], self_test_due_s: float, port: int = PORT) -> None:
        """Start it, and wait until it serves. Raises HardwareError with what it says."""
        descriptor, self.flags = shared_flags()
        # standard input ends with this process, however it ends
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim_robot.desk", f"--flags={descriptor}", f"--port={port}",
             f"--self-test-due-s={self_test_due_s!r}", *addresses],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=(descriptor,), start_new_session=True,
        )  # fmt: skip
        os.close(descriptor)
        assert self._process.stdout is not None
        said = self._process.stdout.readline().strip()
        if said != "serving":
            self.close()
            raise HardwareError(said or "Desk did not start")

    def close(self) -> None:
        """End it."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
