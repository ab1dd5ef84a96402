"""What the host did with the calling thread: computing, waiting for a CPU, page faults, garbage collection.

It is read after a cycle that was late, and after each EVERY cycles, so that a late one has counters of shortly before.
To read them takes some 5 us, after the answer is out.
"""

import contextlib
import gc
import os
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import types

from hal.compilation import bound, compiled
from hal.cycle import WORK

EVERY = 16
REALTIME, MONOTONIC, _PROCESS_CPU, _THREAD_CPU = range(4)  # time.h
_RUSAGE_THREAD = 1  # sys/resource.h
_MINOR, _MAJOR = 8, 9  # of the words of struct rusage, getrusage(2)
_NANO = 1_000_000_000
_SPACE, _ZERO = 32, 48
_LAST_CPU, _LAST_PROCESS, _LAST_NO_CPU, _LAST_MINOR, _LAST_MAJOR = range(5)

_clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
_getrusage = types.ExternalFunction("getrusage", types.int32(types.int32, types.intp))
_pread = types.ExternalFunction("pread", types.int64(types.int32, types.intp, types.uint64, types.int64))


@compiled
def now_ns(which, clock):
    """Return a clock's time; clock: a struct timespec, (2,) int64."""
    _clock_gettime(np.int32(which), clock.ctypes.data)
    return clock[0] * _NANO + clock[1]


@compiled
def _no_cpu_ns(text, descriptor):
    """Return the second number of /proc/thread-self/schedstat: ns on a run queue (Documentation/scheduler)."""
    size = _pread(np.int32(descriptor), text.ctypes.data, np.uint64(text.size), 0)
    value, field = 0, 0
    for k in range(max(0, size)):
        if text[k] == _SPACE:
            field += 1
        elif field == 1:
            value = 10 * value + np.int64(text[k]) - _ZERO
    return value


@compiled
def _take(last, sample, clock, usage, text, descriptor):
    cpu, process = now_ns(_THREAD_CPU, clock), now_ns(_PROCESS_CPU, clock)
    no_cpu = _no_cpu_ns(text, descriptor)
    _getrusage(np.int32(_RUSAGE_THREAD), usage.ctypes.data)
    work = sample[0]
    work.at_us = 1e-3 * now_ns(MONOTONIC, clock)
    work.cpu_us = 1e-3 * (cpu - last[_LAST_CPU])
    work.others_us = 1e-3 * max(0, (process - last[_LAST_PROCESS]) - (cpu - last[_LAST_CPU]))
    work.no_cpu_us = 1e-3 * (no_cpu - last[_LAST_NO_CPU])
    work.page_faults, work.pages_read = usage[_MINOR] - last[_LAST_MINOR], usage[_MAJOR] - last[_LAST_MAJOR]
    last[_LAST_CPU], last[_LAST_PROCESS], last[_LAST_NO_CPU] = cpu, process, no_cpu
    last[_LAST_MINOR], last[_LAST_MAJOR] = usage[_MINOR], usage[_MAJOR]


class HostWork:
    """The counters of the thread that enters the context. `sample` (1,) of WORK, without its t_ns, was read last."""

    def __init__(self) -> None:
        self.sample = np.zeros(1, WORK)
        self._cycles = 0
        self._collected_ns = self._collecting_since_ns = 0
        self._descriptor = -1
        self._last = np.zeros(5, np.int64)
        buffers = (np.zeros(2, np.int64), np.zeros(18, np.int64), np.zeros(96, np.uint8))
        self._take = bound(_take, self._last, self.sample, *buffers, later=(0,))

    def __enter__(self) -> "HostWork":
        with contextlib.suppress(OSError):  # a kernel without it: no thread has ever waited then
            self._descriptor = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        gc.callbacks.append(self._collect)
        self._take(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        gc.callbacks.remove(self._collect)
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def cycle(self, late: bool) -> bool:
        """Count a cycle; return whether `sample` was read anew. Never waits, allocates or raises."""
        self._cycles += 1
        if not late and self._cycles < EVERY:
            return False
        self._take(self._descriptor)
        if self._collecting_since_ns:
            self._collect("stop", {})
        self.sample["cycles"][0], self.sample["collected_us"][0] = self._cycles, 1e-3 * self._collected_ns
        self._cycles = self._collected_ns = 0
        return True

    def _collect(self, phase: str, _: Mapping[str, Any]) -> None:
        """Called by Python at the start and the end of a collection, in whichever thread."""
        if phase == "start":
            self._collecting_since_ns = time.monotonic_ns()
        elif self._collecting_since_ns:
            self._collected_ns += time.monotonic_ns() - self._collecting_since_ns
            self._collecting_since_ns = 0
