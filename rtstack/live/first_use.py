"""The first use of a version on a machine: what motions need is compiled once, before arms may be moved.

    python -m rtstack.live.first_use ARMS

compiles it for cells with so many arms, and shows on stderr how far it is.
"""

import hashlib
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding as llvm
from numba.core import config

from hal.base.files import locked
from hal.compilation import cache_folder

_FILES = {1: 120, 2: 184}  # of machine code, by the number of arms: to show how far it is
_PERIOD_S = 0.2
_ONCE = "compiling, once for this machine"
_PARTS = ("cell", "controller")  # what each process begins with, and one processor has about half of the work


class FirstUse:
    """The compiling of what motions of so many arms need, by processes of its own.

    It is done where it was done for these sources, this compiler and this kind of processor.
    """

    def __init__(self, arms: int) -> None:
        self._arms, self._folder = arms, cache_folder()
        self._stamp, self._lock = self._folder / f"complete-{arms}-{_digest()}", self._folder / "complete.lock"
        self._done = bool(config.DISABLE_JIT)  # pyright: ignore[reportAttributeAccessIssue]  # numba sets it at import
        self._looked_s = 0.0
        self._refusal: str | None = None

    @property
    def done(self) -> bool:
        """Whether nothing is left to do, or what is left could not be done: the motion that needs it waits."""
        self._done = self._done or self._stamp.exists()
        return self._done

    def refusal(self) -> str | None:
        """Return in a line why no motion begins yet; None where all is compiled, or no process is at it."""
        if self.done:
            return None
        if time.monotonic() > self._looked_s + _PERIOD_S:
            self._looked_s = time.monotonic()
            try:
                with locked(self._lock, wait=False):
                    self._refusal = None
            except BlockingIOError:
                self._refusal = f"{_ONCE}: {self._share():.0%}"
        return self._refusal

    def begin(self) -> None:
        """Compile while this process does other things: it says so on stderr, and ends it when it ends."""
        if not self.done:
            print(f"rtstack: {_ONCE}: motions begin in about 30 s, the page says when", file=sys.stderr, flush=True)
            threading.Thread(target=self._compile, args=(False, "nice"), daemon=True, name="compiling").start()

    def wait(self) -> None:
        """Compile, and show on stderr how far it is."""
        if self.done:
            return
        shown = sys.stderr.isatty()
        if not shown:
            print(f"rtstack: {_ONCE}: about 30 s", file=sys.stderr, flush=True)
        self._compile(shown)

    def _compile(self, shown: bool, *before: str) -> None:
        with locked(self._lock):  # another start may be at it
            if self.done:
                return
            self._lock.touch()
            began_s, failed = time.monotonic(), ""
            with ExitStack() as stack:
                command = [*before, sys.executable, "-m", "rtstack.cli.each_motion", str(self._arms)]
                children = [
                    stack.enter_context(
                        subprocess.Popen(
                            [*command, part], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            text=True, start_new_session=True,
                        )
                    )
                    for part in _PARTS
                ]  # fmt: skip
                while any(child.poll() is None for child in children):
                    if shown:
                        line = f"\rrtstack: {_ONCE}: {self._share():.0%}, {time.monotonic() - began_s:.0f} s "
                        print(line, end="", file=sys.stderr, flush=True)
                    time.sleep(_PERIOD_S)
                for child in children:
                    _, said = child.communicate()
                    if child.returncode:
                        failed = said.strip().rpartition("\n")[2] or f"exit status {child.returncode}"
            print("\r\x1b[K" if shown else "", end="", file=sys.stderr, flush=True)
            if failed:
                print(f"rtstack: not all is compiled, a motion waits for the rest: {failed}", file=sys.stderr)
            with suppress(OSError):  # also after a failure, which would come again
                self._stamp.touch()

    def _share(self) -> float:
        """The share that is done: what was compiled since it began."""
        began = self._lock.stat().st_mtime
        made = sum(1 for path in self._folder.glob("*/*.nbc") if path.stat().st_mtime >= began)
        return min(0.99, made / _FILES[self._arms])


def _digest() -> str:
    root = Path(__file__).parents[2]
    digest = hashlib.sha256(repr((root, sys.version, version("numba"), llvm.get_host_cpu_name())).encode())
    for path in sorted(path for name in ("hal", "sim_robot", "rtstack") for path in (root / name).rglob("*.py")):
        if b"\n@compiled" in (source := path.read_bytes()):
            digest.update(source)
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    FirstUse(int(sys.argv[1])).wait()
