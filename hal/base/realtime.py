"""What a thread that must keep real time asks of the host, and what it obtained. Nothing here is needed in lockstep."""

import ctypes
import gc
import os
import platform
import signal
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache

# below the simulated robot (80), which has to keep its own clock, and above everything ordinary
PRIORITY = 70
_BESIDE = 60  # other threads of a process with such a thread
_FIFO = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30  # linux/prctl.h
_PR_SET_PDEATHSIG = 1
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # bits/mman-linux.h
ANY_CPU = -1
# an ordinary thread that asks for slices this short is let run before others when it wakes (Linux 6.12 and newer,
# sched_setattr(2)): what it does in a millisecond takes longer, but it begins on time
_SHORT_SLICE_NS = 100_000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}.get(platform.machine())
_SCHED_ATTR = struct.Struct("=IIQiIQQQ")  # size, policy, flags, nice, priority, runtime (slice), deadline, period
_libc = ctypes.CDLL(None, use_errno=True)
_POLICIES = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr"}


@dataclass(frozen=True, slots=True)
class Obtained:
    """What the calling thread got. scheduler: fifo or other; cpu: where it stays, -1 anywhere; gc: on or off."""

    scheduler: str
    priority: int
    cpu: int
    memory_locked: bool
    timer_slack_ns: int
    gc: str

    def as_dict(self) -> dict[str, str]:
        """Return the fields as text, for the log's metadata."""
        return {name: str(value) for name, value in asdict(self).items()}


def end_with_parent() -> None:
    """In a child: be sent SIGTERM when the parent ends, however it ends, and take it where the parent blocks it."""
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def robot_cpu() -> int:
    """Return the CPU for a simulated robot on this host: the first, away from the loop; ANY_CPU where there is one."""
    cpus = os.sched_getaffinity(0)
    return min(cpus) if len(cpus) > 1 else ANY_CPU


@contextmanager
def realtime_thread(priority: int = PRIORITY, cpu: int | None = None) -> Iterator[Obtained]:
    """Make the calling thread a real-time one as far as the host allows; take everything back at the end: FIFO
    (priority 0, or refused: an ordinary thread with short slices), one CPU (None: the last one; ANY_CPU: as it was),
    memory locked, timer slack 1 ns, no garbage collection.

    What was obtained is given.
    """
    policy, parameters, cpus = os.sched_getscheduler(0), os.sched_getparam(0), os.sched_getaffinity(0)
    slack_ns = _libc.prctl(_PR_GET_TIMERSLACK)
    collecting = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    # what is mapped becomes memory now: where the kernel gives 2 MB at a time, a first touch costs 8 ms
    locked = _libc.mlockall(_MCL_CURRENT) == 0
    locked = _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0 and locked
    _libc.prctl(_PR_SET_TIMERSLACK, 1)
    fifo = priority > 0 and _allowed(os.sched_setscheduler, _FIFO, os.sched_param(priority))
    if not fifo:
        _try_slice(_SHORT_SLICE_NS)
    chosen = max(cpus) if cpu is None else cpu
    # staying on one CPU helps only who cannot be pushed off it
    pinned = chosen != ANY_CPU and fifo and _allowed(os.sched_setaffinity, {chosen})
    try:
        kept, slack_now_ns = os.sched_getparam(0).sched_priority, _libc.prctl(_PR_GET_TIMERSLACK)
        yield Obtained("fifo" if fifo else "other", kept, chosen if pinned else ANY_CPU, locked, slack_now_ns, gc="off")
    finally:
        _allowed(os.sched_setscheduler, policy, parameters)
        if not fifo:
            _try_slice(0)
        _allowed(os.sched_setaffinity, cpus)
        _libc.prctl(_PR_SET_TIMERSLACK, slack_ns)
        if locked:
            _libc.munlockall()
        gc.unfreeze()
        if collecting:
            gc.enable()


def beside_realtime() -> None:
    """Put the calling thread between ordinary ones and its process's real-time thread, as far as the host allows it: an
    ordinary thread that is pushed off its CPU with the interpreter's lock keeps the real-time one waiting."""
    _allowed(os.sched_setscheduler, _FIFO, os.sched_param(_BESIDE))


def ordinary_thread() -> None:
    """Put the calling thread back to ordinary scheduling: the process that started it may have had a priority."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def scheduling(thread: int = 0) -> tuple[str, int]:
    """Return policy (other, fifo, rr) and priority of the calling thread, or of one by its id."""
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return _POLICIES.get(policy, "unknown"), os.sched_getparam(thread).sched_priority


@lru_cache(maxsize=1)  # of a process: to try it takes a quarter of a second
def obtainable() -> Obtained:
    """Return what `realtime_thread` obtains in this process."""
    with realtime_thread() as obtained:
        return obtained


def _allowed(call: Callable[..., None], *arguments: object) -> bool:
    """Make a call about the calling thread; return whether the host allowed it."""
    try:
        call(0, *arguments)
    except OSError:
        return False
    return True


def _try_slice(nanoseconds: int) -> None:
    """Ask for slices of this length for the calling ordinary thread, 0 for the kernel's own; refusal is no error."""
    if _SCHED_SETATTR is None or os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_OTHER:
        return
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attributes = _SCHED_ATTR.pack(_SCHED_ATTR.size, os.SCHED_OTHER, 0, nice, 0, nanoseconds, 0, 0)
    _libc.syscall(_SCHED_SETATTR, 0, attributes, 0)
