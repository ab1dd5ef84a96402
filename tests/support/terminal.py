"""A terminal at which a person confirms that the arms may move, and holds the space bar."""

import os
import pty
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

REPEATED_S = 0.02  # as a held key
_LOOK_S = 0.005


def _for_ever(_said: str) -> bool:
    return False


class Terminal:
    """A pair of descriptors: `theirs` is the program's, which begins there; then `hold` until it has ended."""

    def __init__(self) -> None:
        self._ours, self.theirs = pty.openpty()
        self._said: list[str] = []
        self._ended, self._open, self._lock = threading.Event(), True, threading.Lock()

    @property
    def said(self) -> str:
        """What the program has said there."""
        return "".join(self._said)

    def hold(self, name: str = "grab", until: Callable[[str], bool] = _for_ever, hang_up: bool = False) -> None:
        """Confirm with the cell's name and hold the space bar, until `until` (what was said), or the program's end.

        hang_up: the terminal is closed then.
        """
        with self._confirmed(name, hang_up):
            while not self._ended.is_set() and not until(self.said):
                self._write(" ")
                time.sleep(REPEATED_S)

    def watch(self, presses: Sequence[tuple[Callable[[str], bool], str]], name: str = "grab") -> None:
        """Confirm with the cell's name, then press each key once its condition (what was said) is met."""
        with self._confirmed(name):
            for due, key in presses:
                while not self._ended.is_set() and not due(self.said):
                    time.sleep(REPEATED_S)
                self._write(key)

    @contextmanager
    def _confirmed(self, name: str, hang_up: bool = False) -> Iterator[None]:
        os.close(self.theirs)
        listener = threading.Thread(target=self._listen, daemon=True)
        listener.start()
        while "and Enter" not in self.said and not self._ended.is_set():
            time.sleep(REPEATED_S)
        self._write(f"{name}\n")
        yield
        if not hang_up:
            listener.join()
        with self._lock:
            self._open = False
            os.close(self._ours)

    def _write(self, text: str) -> None:
        try:
            os.write(self._ours, text.encode())
        except OSError:  # the program has ended
            self._ended.set()

    def _listen(self) -> None:
        """Take what is said. It does not wait in a read, which would keep a terminal open that is being closed."""
        os.set_blocking(self._ours, False)
        while True:
            try:
                with self._lock:
                    if not self._open:
                        break
                    data = os.read(self._ours, 4096)
            except BlockingIOError:
                time.sleep(_LOOK_S)
                continue
            except OSError:  # the other end is closed
                break
            if not data:
                break
            self._said.append(data.decode(errors="replace"))
        self._ended.set()
