"""What the host allows a loop that must keep real time. Nothing here is required: a simulator waits."""

import os
import platform
import time
from pathlib import Path

import numpy as np

from hal.base.realtime import realtime_thread
from rtstack.check.finding import Finding, finding

_SYS = Path("/sys")
_TIMER_SAMPLES = 500
# an answer that leaves later than this after its state is lost on the robot's side of 1 ms (libfranka: 300 us to spare)
_LATE_US = 300.0
_SET_UP = "sudo rtstack host-setup"


def host_findings(sys: Path = _SYS) -> list[Finding]:
    """Look at scheduler, memory lock, timer, kernel, governor, CPUs, clock: 0.5 s. sys: the kernel's /sys."""
    with realtime_thread() as obtained:
        late_us = _timer_lateness_us()
    late = float(np.percentile(late_us, 99))
    realtime = _text(sys / "kernel/realtime") == "1"
    governor = _text(sys / "devices/system/cpu/cpu0/cpufreq/scaling_governor") or "not reported"
    clock = _text(sys / "devices/system/clocksource/clocksource0/current_clocksource") or "not reported"
    return [
        finding(
            "scheduler", f"{obtained.scheduler} {obtained.priority}", obtained.scheduler == "fifo",
            "any busy process delays ticks, and packets are lost",
            f"allow SCHED_FIFO: `{_SET_UP} --user {_user()}`, then log in again",
        ),
        finding(
            "memory lock", "locked" if obtained.memory_locked else "refused", obtained.memory_locked,
            "a page that is touched for the first time costs up to 8 ms, in the middle of a motion",
            f"allow mlockall: `{_SET_UP} --user {_user()}`, then log in again",
        ),
        finding(
            "timer", f"{late:.0f} us late at p99, {late_us.max():.0f} us at most", late < _LATE_US,
            "answers leave too late: the robot loses them, and stops after 20 in a row",
            "the host is busy, or a virtual machine: keep it for the loop alone",
        ),
        finding(
            "kernel", f"{platform.release()}{', real-time' if realtime else ''}", realtime,
            "not PREEMPT_RT: single ticks are late by milliseconds; good for the simulated robot, not for experiments",
            f"`{_SET_UP} --kernel rt`, and restart",
        ),
        finding(
            "CPU governor", governor, governor in ("performance", "not reported"),
            "a CPU that has slowed down takes longer for a tick", f"`{_SET_UP}`",
        ),
        _isolation(sys),
        finding(
            "clock", clock, clock in ("tsc", "arch_sys_counter", "not reported"),
            "reading the time goes through the kernel or a hypervisor: some us a tick, and jumps on a virtual machine",
            "a machine of its own, with a TSC that the kernel trusts",
        ),
    ]  # fmt: skip


def _isolation(sys: Path) -> Finding:
    isolated = _text(sys / "devices/system/cpu/isolated")
    allowed = os.sched_getaffinity(0)
    advice, good = f"`{_SET_UP}`, and restart", bool(isolated)
    cost = "the loop shares its CPU with whatever else runs"
    if isolated:
        last = int(isolated.replace(",", "-").rpartition("-")[2])
        if last not in allowed:
            good, cost = False, "the loop takes the last CPU that it may use, and that is not an isolated one"
            advice = f"start it with `taskset --cpu-list 0-{last} rtstack up`, or as a unit"
    return finding("isolated CPUs", isolated or "none", good, cost, advice)


def _user() -> str:
    return os.environ.get("USER") or "NAME"


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _timer_lateness_us() -> np.ndarray:
    """Lateness of 1 ms sleeps against absolute deadlines, (n,) us."""
    late = np.empty(_TIMER_SAMPLES)
    deadline_ns = time.monotonic_ns()
    for k in range(_TIMER_SAMPLES):
        deadline_ns = max(deadline_ns + 1_000_000, time.monotonic_ns())
        time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
        late[k] = max(0, time.monotonic_ns() - deadline_ns) * 1e-3
    return late
