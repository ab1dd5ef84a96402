"""What a worker does with a task: compare its files, call the function, add to the rows where they come from."""

import atexit
import gc
import hashlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import resource_tracker
from pathlib import Path
from types import ModuleType
from typing import Any

from rtstack.trials.provenance import git_commit

Sources = tuple[tuple[Path, str], ...]


class WorkerMismatch(Exception):
    """A worker that would compute something else than the others: it has other files."""


@contextmanager
def starting() -> Iterator[None]:
    """Start worker processes: Ctrl-C does not reach them, and a script is not run anew in each."""
    resource_tracker.ensure_running()  # its first start would unblock the signals in the thread that needs it
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def digests(paths: Iterable[Path]) -> Sources:
    return tuple((path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in paths)


def run_cases(
    function: Callable[..., list[dict[str, Any]]], arguments: tuple[Any, ...], sources: Sources, digest: str
) -> list[dict[str, Any]]:
    """Run a task with cases. Returns its rows, with git_commit, digest, wall_s and worker."""
    _check(sources)
    began_s = time.perf_counter()
    rows = function(*arguments)
    if not isinstance(rows, list):
        raise TypeError(f"a task returned a {type(rows).__name__}, not a list of rows")
    wall_s = (time.perf_counter() - began_s) / max(1, len(rows))
    worker = f"{os.uname().nodename}:{os.getpid()}"
    origin = {"git_commit": git_commit(), "digest": digest, "wall_s": wall_s, "worker": worker}
    return [row | origin for row in rows]


def run_stage(function: Callable[..., str | None], arguments: tuple[Any, ...], sources: Sources) -> str | None:
    _check(sources)
    return function(*arguments)


@lru_cache(maxsize=4)
def _check(sources: Sources) -> None:
    """Raise WorkerMismatch where a file is another one here than where the campaign was begun."""
    for path, digest in sources:
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise WorkerMismatch(f"a worker on {os.uname().nodename} has another {path} than the campaign")
    gc.freeze()  # what is imported stays: collections need not look at it after every log
    atexit.register(gc.unfreeze)  # but the last one, before libraries look for what has outlived them
