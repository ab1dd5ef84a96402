"""Programs that the console starts: they stand back behind the robot's loop, which may run on the same machine."""

import os
import subprocess
import sys
from collections.abc import Callable

# A third of the processor time of a program of niceness 0 beside it (kernel/sched: weights 1024 and 335).
# At 10 it is a tenth: what the operator waits for took minutes where other programs keep both cores busy.
NICENESS = 5


def stand_back() -> None:
    """Lower this process's priority."""
    os.nice(NICENESS)


def start(
    module: str, *arguments: str, stdin: int = subprocess.DEVNULL, stdout: int = subprocess.DEVNULL,
    stderr: int = subprocess.DEVNULL, preexec_fn: Callable[[], None] | None = None,
) -> "subprocess.Popen[bytes]":  # fmt: skip
    """Start `python -m MODULE ARGUMENTS`, which computes in one thread. The others: as for Popen."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdin=stdin, stdout=stdout, stderr=stderr, preexec_fn=preexec_fn,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


def end(process: "subprocess.Popen[bytes]", patience_s: float) -> None:
    """End a process in order, and by force where it has not ended after patience_s."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
