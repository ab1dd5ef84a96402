"""Programs that the console starts: they stand back behind the robot's loop, which may run on the same machine."""

import faulthandler
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

# A third of the processor time of a program of niceness 0 beside it (kernel/sched: weights 1024 and 335).
# At 10 it is a tenth: what the operator waits for took minutes where other programs keep both cores busy.
NICENESS = 5
MEMORY_GB = 4  # a log of ten minutes takes less than one
_PROCESSOR_S = 1800  # a log of ten minutes takes one minute
_GRACE_S = 2.0  # of code that does not come back to Python


def stand_back() -> None:
    """Lower this process's priority."""
    os.nice(NICENESS)


def start(
    module: str, *arguments: str, stdin: int = subprocess.DEVNULL, stdout: int = subprocess.DEVNULL,
    stderr: int = subprocess.DEVNULL, preexec_fn: Callable[[], None] | None = None,
) -> "subprocess.Popen[bytes]":  # fmt: skip
    """Start `python -m MODULE ARGUMENTS`, in one thread, within bounds of memory and time. The others: as for Popen."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdin=stdin, stdout=stdout, stderr=stderr, preexec_fn=preexec_fn,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    with suppress(ProcessLookupError):  # it has ended already
        # RLIMIT_DATA does not count a file that is mapped (man 2 getrlimit)
        resource.prlimit(process.pid, resource.RLIMIT_DATA, (MEMORY_GB << 30, MEMORY_GB << 30))
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (_PROCESSOR_S, _PROCESSOR_S))
    return process


@contextmanager
def within(limit_s: float) -> Iterator[None]:
    """Raise TimeoutError in the block once it takes longer; end this process where it does not come back to Python.

    For the main thread of a process that runs what a plug-in brings.
    """

    def late(*_: object) -> None:
        raise TimeoutError(f"takes longer than {limit_s:g} s")

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    faulthandler.dump_traceback_later(limit_s + _GRACE_S, exit=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()


def why_ended(status: int | None) -> str:
    """Return why a program has ended early, by its exit status, in words for the operator."""
    if status in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"it took more than {MEMORY_GB} GB of memory or {_PROCESSOR_S // 60} minutes"
    return f"it ended unexpectedly (status {status}): try again"


def end(process: "subprocess.Popen[bytes]", patience_s: float) -> None:
    """End a process in order, and by force where it has not ended after patience_s."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
