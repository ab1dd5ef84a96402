"""Hold-to-run at the terminal: arms that are not simulated move only while a person holds the space bar.

A terminal repeats a key that is held. The first repetition comes after a quarter to a whole second, the others some 30
times a second: the run begins with the second one, and ends through the judge's stop, as with a clutch, once none has
come for as long as a clutch may be silent. A terminal that is closed, and a connection that is lost, repeat nothing.
"""

import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hal.base.realtime import beside_realtime
from rtstack.cells import kind_of
from rtstack.cli.interrupt import Interrupt
from rtstack.loop.end import End
from rtstack.loop.watchdogs import CLUTCH_S, Heartbeat, Watchdog, since_boot_s
from rtstack.model.cell_description import CellDescription
from rtstack.safety.arming import LEASE_S
from rtstack.trials.errors import TrialError

_LOOK_S = 0.05


class HoldToRun:
    """What stands between a command and the arms of a cell: nothing where they are simulated (`real`, `needed`)."""

    def __init__(
        self, cell_kind: str, description: CellDescription, cell_file: Path, led: bool = False, moves: bool = True
    ) -> None:
        """led: a person leads the arms, measured or not; moves: an arm is to move. Raises TrialError."""
        kind, argument = kind_of(cell_kind)
        kind.check(argument, description, cell_file)
        if not led:
            kind.measured(argument, description, cell_file)
        self.real = not kind.simulated(argument, description)
        self.needed = self.real and moves
        self._cell, self._name = f"{description.name} ({cell_kind})", description.name
        self._held_ns, self._confirmed = 0, False
        if self.needed and not (sys.stdin.isatty() and sys.stderr.isatty()):
            raise TrialError(
                f"the arms of {self._cell} are not simulated: they move only while a person holds the space bar, so "
                "give the command in a terminal; or use the page (rtstack up)"
            )

    @contextmanager
    def held(self, what: str, stop: Interrupt) -> Iterator[tuple[Watchdog, ...]]:
        """Ask once, wait until the space bar is held; give the watchdogs of the run. stop: raised once it is let go.

        Raises TrialError where the person does not confirm.
        """
        if not self.needed:
            yield ()
            return
        if not self._confirmed:
            self._confirm(what)
        self._confirmed, self._held_ns = True, 0
        with self._keys() as descriptor:
            _say("Hold the space bar. The arms move while it is held; let it go, and they stop.")
            self._await_key(descriptor, stop)
            with _beside(self._watch, descriptor, stop):
                yield (Heartbeat(lambda: self._held_ns, CLUTCH_S, End.RELEASED),)

    @contextmanager
    def watched(self, what: str, stop: Interrupt, pause: Callable[[], None]) -> Iterator[None]:
        """Ask once; then the arms move by themselves while a person watches: any key stops them, p pauses.

        stop: raised at a key, when the terminal is gone, and after a suspension. pause: called at p. Raises TrialError.
        """
        if not self.needed:
            yield
            return
        self._confirm(what)
        with self._keys() as descriptor:
            _say("The arms move by themselves. Stay and watch: any key stops them, p pauses after the present motion.")
            with _beside(self._watch_keys, descriptor, stop, pause):
                yield

    def _watch_keys(self, descriptor: int, stop: Interrupt, pause: Callable[[], None], done: threading.Event) -> None:
        beside_realtime()
        looked_s = since_boot_s()
        while not done.is_set():
            keys, before_s, looked_s = _keys(descriptor), looked_s, since_boot_s()
            # the person may have left while the machine was suspended, or this process stopped (Ctrl-Z)
            if looked_s - before_s > LEASE_S:
                keys = b""
            if keys == b"p":
                pause()
            elif keys is not None:
                stop.stop_requested = True
                return

    @contextmanager
    def _keys(self) -> Iterator[int]:
        """Give the terminal's descriptor, on which each key arrives at once."""
        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
        try:
            tty.setcbreak(descriptor)
            yield descriptor
        finally:
            with suppress(termios.error):  # the terminal may be gone
                termios.tcsetattr(descriptor, termios.TCSAFLUSH, before)

    def _confirm(self, what: str) -> None:
        _say(f"{what}: the arms of {self._cell} are NOT simulated and will move.")
        _say("No person may be within reach; keep a hand at the emergency stop.")
        _say(f"Type the cell's name, {self._name}, and Enter: ", "")
        if sys.stdin.readline().strip() != self._name:
            raise TrialError("not confirmed: nothing has moved")

    def _await_key(self, descriptor: int, stop: Interrupt) -> None:
        before_ns = 0
        while not self._held_ns:
            if stop.stop_requested:
                raise TrialError("interrupted: nothing has moved")
            if _space(descriptor):
                now_ns = time.monotonic_ns()
                if now_ns - before_ns < CLUTCH_S * 1e9:
                    self._held_ns = now_ns
                before_ns = now_ns

    def _watch(self, descriptor: int, stop: Interrupt, done: threading.Event) -> None:
        beside_realtime()
        while not done.is_set():
            if _space(descriptor):
                self._held_ns = time.monotonic_ns()
            elif time.monotonic_ns() - self._held_ns > CLUTCH_S * 1e9:
                stop.stop_requested = True
                return


@contextmanager
def _beside(watch: Callable[..., None], *arguments: object) -> Iterator[None]:
    """Run a watch in a thread beside the block, until its event, the last argument, is set."""
    done = threading.Event()
    thread = threading.Thread(target=watch, args=(*arguments, done), daemon=True, name="hold-to-run")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _space(descriptor: int) -> bool:
    """Return whether the space bar came within a moment. A terminal that is gone gives nothing."""
    keys = _keys(descriptor)
    if keys == b"":
        time.sleep(_LOOK_S)
    return keys is not None and b" " in keys


def _keys(descriptor: int) -> bytes | None:
    """Return what came within a moment, None for nothing; empty where the terminal is gone."""
    ready, _, _ = select.select([descriptor], [], [], _LOOK_S)
    if not ready:
        return None
    try:
        return os.read(descriptor, 64)
    except OSError:
        return b""


def _say(text: str, end: str = "\n") -> None:
    print(text, end=end, file=sys.stderr, flush=True)
