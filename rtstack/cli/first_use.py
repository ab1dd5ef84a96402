"""The first use of a version on a machine: what motions need is compiled before a stack starts, so no arm waits."""

import hashlib
import subprocess
import sys
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding as llvm
from numba.core import config

from hal.base.files import locked
from hal.compilation import cache_folder

_FILES = {1: 120, 2: 184}  # of machine code, by the number of arms: to show how far it is
_PERIOD_S = 0.2


def compile_once(arms: int) -> None:
    """Compile what motions of so many arms need, in a process of its own, and show on stderr how far it is.

    Returns at once where it was done for these sources, this compiler and this kind of processor.
    """
    folder = cache_folder()
    done = folder / f"complete-{arms}-{_digest()}"
    if done.exists() or config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]  # numba sets it at import
        return
    with locked(folder / "complete.lock"):  # another start may be at it
        if not done.exists():
            _compile(arms, folder)
        with suppress(OSError):  # also after a failure, which would come again
            done.touch()


def _compile(arms: int, folder: Path) -> None:
    before, began_s, shown = _files(folder), time.monotonic(), sys.stderr.isatty()
    if not shown:
        print("rtstack: compiling, once for this machine: about 50 s", file=sys.stderr, flush=True)
    with subprocess.Popen(
        [sys.executable, "-m", "rtstack.cli.each_motion", str(arms)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as child:  # fmt: skip
        while child.poll() is None:
            share, passed_s = min(0.99, (_files(folder) - before) / _FILES[arms]), time.monotonic() - began_s
            if shown:
                line = f"\rrtstack: compiling, once for this machine: {share:.0%}, {passed_s:.0f} s "
                print(line, end="", file=sys.stderr, flush=True)
            time.sleep(_PERIOD_S)
        _, said = child.communicate()
    print("\r\x1b[K" if shown else "", end="", file=sys.stderr, flush=True)
    if child.returncode:
        why = said.strip().rpartition("\n")[2] or f"exit status {child.returncode}"
        print(f"rtstack: not everything is compiled, the first motion waits for the rest: {why}", file=sys.stderr)


def _files(folder: Path) -> int:
    return sum(1 for _ in folder.glob("*/*.nbc"))


def _digest() -> str:
    root = Path(__file__).parents[2]
    digest = hashlib.sha256(repr((root, sys.version, version("numba"), llvm.get_host_cpu_name())).encode())
    for path in sorted(path for name in ("hal", "sim_robot", "rtstack") for path in (root / name).rglob("*.py")):
        if b"\n@compiled" in (source := path.read_bytes()):
            digest.update(source)
    return digest.hexdigest()[:16]
