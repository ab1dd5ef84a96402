"""Servers in their own process (pylibfranka holds the GIL while it waits), on addresses of each test's own.

Each is a fork of one process that has imported and compiled everything: it serves within a tenth of a second instead
of two, so that every test can have its own, whose plant has not moved and which nobody has left in a reflex.
"""

import atexit
import contextlib
import functools
import itertools
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

END_S = 30.0
_last_octet = itertools.cycle(range(1, 255))


@dataclass(frozen=True, slots=True)
class Served:
    """A running server, by process id and descriptor, and where its arms are. said: its last lines, at the end."""

    pid: int
    descriptor: int
    left: str
    right: str
    said: list[str] = field(default_factory=list)

    @property
    def alive(self) -> bool:
        """False once the process has ended."""
        return not _readable(self.descriptor, 0.0)


def _readable(descriptor: int, seconds: float) -> bool:
    return bool(select.select((descriptor,), (), (), seconds)[0])


def addresses() -> tuple[str, str]:
    """Return two loopback addresses that nobody else uses."""
    # the process id keeps two test runs on one machine apart
    number = os.getpid()
    left, right = (f"127.{2 + number // 250 % 14}.{1 + number % 250}.{next(_last_octet)}" for _ in range(2))
    return left, right


@functools.cache
def _template() -> socket.socket:
    """Start the process that forks servers; what is sent there is server_template's request."""
    ours, theirs = socket.socketpair()
    program = Path(__file__).with_name("server_template.py")
    command = [sys.executable, str(program), str(theirs.fileno()), *addresses()]
    process = subprocess.Popen(command, pass_fds=(theirs.fileno(),))
    theirs.close()

    def end() -> None:
        ours.close()
        process.wait(END_S)

    atexit.register(end)
    return ours


@contextlib.contextmanager
def serve(*arguments: str) -> Iterator[Served]:
    """Run what `rtstack sim` runs, wait until it serves, and end it."""
    left, right = addresses()
    read, write = os.pipe()
    with open(read) as output:
        request = json.dumps(["--left", left, "--right", right, "--tracker", "", "--cpu", "-1", *arguments]).encode()
        socket.send_fds(_template(), [request], [write])
        os.close(write)
        served = Served(number := int(_template().recv(16)), os.pidfd_open(number), left, right)
        try:
            said = ""
            for line in output:
                if line.startswith("serving"):
                    break
                said += line
            else:
                raise RuntimeError(f"the server did not start: {said}")
            yield served
            assert served.alive, "the server died during the test: " + output.read()
        finally:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(served.descriptor, signal.SIGTERM)
            ended = _readable(served.descriptor, END_S)
            os.close(served.descriptor)
            if ended:
                served.said.extend(output.read().splitlines())
        assert ended, "the server did not end"
