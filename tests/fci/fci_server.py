"""Servers in their own process (pylibfranka holds the GIL while it waits), on addresses of each test's own."""

import contextlib
import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

_last_octet = itertools.count(1)


@dataclass(frozen=True, slots=True)
class Served:
    """A running server and where its arms are."""

    process: subprocess.Popen
    left: str
    right: str


@contextlib.contextmanager
def serve(*arguments: str) -> Iterator[Served]:
    """Start `python -m sim_robot.fci`, wait until it serves, and end it."""
    # the process id keeps two test runs on one machine apart
    third = 1 + os.getpid() % 250
    left, right = (f"127.{third}.1.{next(_last_octet)}" for _ in range(2))
    command = [sys.executable, "-m", "sim_robot.fci", "--left", left, "--right", right, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                if line.startswith("serving"):
                    break
            else:
                raise RuntimeError("the server did not start")
            yield Served(process, left, right)
            assert process.poll() is None, "the server died during the test"
        finally:
            process.terminate()
            process.communicate(timeout=30)
