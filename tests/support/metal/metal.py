"""Arms that are served as metal: a watched robot on loopback, the file of its cell, a person at a terminal."""

import contextlib
import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.fci.raw import RawClient
from tests.support.metal.watched_robot import opened
from tests.support.network.namespaces import Namespace
from tests.support.real_cell import write_cell_file
from tests.support.terminal import Terminal

# A command in lockstep has no watchdog of the time of day, since the machine may be slow
_PATIENT = """
import hal.fci.pair, rtstack.loop.watchdogs
hal.fci.pair.STALE_S = hal.fci.pair.STALE_IN_LOCKSTEP_S
rtstack.loop.watchdogs.OVERRUN_TICKS = 10_000
"""
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_libc = ctypes.CDLL(None)
LONGEST_S = 150.0  # of a command; the tick may have to be compiled first
_END_S = 10.0


@dataclass(slots=True)
class Metal:
    """Addresses, files and the robot's process. prefix: of the addresses; namespace: where all of it runs."""

    folder: Path
    lockstep: bool
    prefix: str = field(default_factory=lambda: f"127.{16 + os.getpid() // 250 % 230}.{1 + os.getpid() % 250}")
    namespace: Namespace | None = None
    robot: subprocess.Popen[str] | None = None
    others: list[RawClient] = field(default_factory=list)  # clients that are not the command's

    @property
    def left(self) -> str:
        return f"{self.prefix}.2"

    @property
    def right(self) -> str:
        return f"{self.prefix}.3"

    @property
    def tracker(self) -> str:
        return f"{self.prefix}.1:1341"

    @property
    def kind(self) -> str:
        return f"fci:{self.left},{self.right}"

    @property
    def cell_file(self) -> Path:
        return self.folder / "cell.toml"

    @property
    def seen(self) -> np.void:
        """What was seen of the plant (WATCHED)."""
        return opened(self.folder / "watched")[0]

    def write_file(self) -> str:
        """Write the cell's file as it should be; return its text."""
        return write_cell_file(self.cell_file, self.left, self.right, self.tracker)

    def serve(self, options: Sequence[str] = (), prelude: str = "") -> None:
        """Start the robot, and wait until it serves. prelude: Python that it begins with.

        Raises RuntimeError with what it says.
        """
        watched = self.folder / "watched"
        if not watched.exists():
            opened(watched, new=True)
        pace = ["--lockstep"] if self.lockstep else []
        addresses = ["--left", self.left, "--right", self.right, "--tracker", self.tracker]
        watcher = [sys.executable, "-m", "tests.support.metal.watched_robot", str(watched), prelude]
        command = [*watcher, *addresses, *pace, *options]
        self.robot = self.start(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                 text=True, start_new_session=True)  # fmt: skip
        assert self.robot.stdout is not None
        said = []
        for line in self.robot.stdout:
            if line.startswith("serving"):
                return
            said.append(line.strip())
        raise RuntimeError(f"the robot is not served: {' '.join(said)}")

    def start(self, command: Sequence[str], **options) -> subprocess.Popen:
        """Start a program where the robot is."""
        if self.namespace is not None:
            return self.namespace.start(*command, **options)
        more: dict[str, Any] = {"preexec_fn": _end_with_parent, **options}
        return subprocess.Popen(command, **more)

    @contextlib.contextmanager
    def command(self, words: Sequence[str], prelude: str = "", leads: bool = False) -> "Iterator[AtTerminal]":
        """Start `rtstack` at a terminal of its own; it is killed at the end.

        prelude: Python that it begins with. leads: it is the terminal's session leader, which the kernel sends a SIGHUP
        when the terminal is closed; else it is a job of this session, which can be suspended.
        """
        code = (_PATIENT if self.lockstep else "") + prelude + "\nimport rtstack.cli\nrtstack.cli.main()"
        terminal = Terminal()
        ends = terminal.theirs
        session: dict[str, Any] = {"preexec_fn": _lead} if leads else {"process_group": 0}
        process = self.start([sys.executable, "-c", code, *words], stdin=ends, stdout=ends, stderr=ends, **session)
        try:
            yield AtTerminal(process, terminal)
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            process.wait()

    def end(self) -> None:
        """End the robot, and who else is connected."""
        for client in self.others:
            client.close()
        self.others.clear()
        robot, self.robot = self.robot, None
        if robot is not None:
            robot.send_signal(signal.SIGCONT)
            robot.terminate()
            try:
                robot.communicate(timeout=_END_S)
            except subprocess.TimeoutExpired:
                robot.kill()
                robot.communicate()


def _end_with_parent() -> None:
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _lead() -> None:
    _end_with_parent()
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY)


@dataclass(slots=True)
class AtTerminal:
    """A command that runs at its terminal."""

    process: subprocess.Popen
    terminal: Terminal

    def carry_out(self, hold: Callable[[], None], act: Callable[[], object] | None = None) -> int | None:
        """Have a person do what `hold` does at the terminal, and meanwhile `act`; return the exit status, None where
        the command hangs."""
        threads = [threading.Thread(target=what, daemon=True) for what in (hold, act) if what is not None]
        for thread in threads:
            thread.start()
        try:
            return self.process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            return None
        finally:
            self.process.kill()
            for thread in threads:
                thread.join(5.0)
