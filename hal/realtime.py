"""What a thread that must keep real time asks of the host, and what it obtained. Nothing here is needed in lockstep."""

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache

# below the simulated robot (80), which has to keep its own clock, and above everything ordinary
PRIORITY = 70
_BESIDE = 60  # other threads of a process with such a thread
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30  # linux/prctl.h
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # bits/mman-linux.h
ANY_CPU = -1
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


def robot_cpu() -> int:
    """Return the CPU for a simulated robot on this host: the first, away from the loop; ANY_CPU where there is one."""
    cpus = os.sched_getaffinity(0)
    return min(cpus) if len(cpus) > 1 else ANY_CPU


@contextmanager
def realtime_thread(priority: int = PRIORITY, cpu: int | None = None) -> Iterator[Obtained]:
    """Make the calling thread a real-time one as far as the host allows; take everything back at the end.

    FIFO (priority 0: as it was), one CPU (None: the last one; ANY_CPU: as it was), memory locked, timer slack 1 ns, no
    garbage collection. What the host refuses is left as it is, and told.
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
    fifo = priority > 0 and _try_schedule(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    chosen = max(cpus) if cpu is None else cpu
    # staying on one CPU helps only who cannot be pushed off it
    pinned = chosen != ANY_CPU and fifo and _try_affinity({chosen})
    try:
        yield Obtained(
            scheduler="fifo" if fifo else "other",
            priority=os.sched_getparam(0).sched_priority,
            cpu=chosen if pinned else -1,
            memory_locked=locked,
            timer_slack_ns=_libc.prctl(_PR_GET_TIMERSLACK),
            gc="off",
        )
    finally:
        _try_schedule(policy, parameters)
        _try_affinity(cpus)
        _libc.prctl(_PR_SET_TIMERSLACK, slack_ns)
        if locked:
            _libc.munlockall()
        gc.unfreeze()
        if collecting:
            gc.enable()


def beside_realtime() -> None:
    """Put the calling thread between what is ordinary and its process's real-time thread, as far as the host allows it.

    The threads of a process share the interpreter's lock: an ordinary one that holds it and is pushed off its CPU by
    another program keeps the real-time thread waiting for as long as that one runs.
    """
    _try_schedule(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_BESIDE))


def scheduling(thread: int = 0) -> tuple[str, int]:
    """Return policy (other, fifo, rr) and priority of a thread now: the calling one, or one by its id.

    A process's main thread has the id of the process.
    """
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return _POLICIES.get(policy, "unknown"), os.sched_getparam(thread).sched_priority


@lru_cache(maxsize=1)  # of a process: to try it takes a quarter of a second
def obtainable() -> Obtained:
    """Return what `realtime_thread` obtains in this process."""
    with realtime_thread() as obtained:
        return obtained


def _try_schedule(policy: int, parameters: os.sched_param) -> bool:
    try:
        os.sched_setscheduler(0, policy, parameters)
    except PermissionError:
        return False
    return True


def _try_affinity(cpus: set[int]) -> bool:
    try:
        os.sched_setaffinity(0, cpus)
    except OSError:
        return False
    return True
