"""What the host allows a loop that must keep real time."""

import platform
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hal.realtime import realtime_thread

_GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
_REALTIME_KERNEL = Path("/sys/kernel/realtime")  # there, and 1, on a PREEMPT_RT kernel
_TIMER_SAMPLES = 500
# an answer that leaves later than this after its state is lost on the robot's side of 1 ms (libfranka: 300 us to spare)
_LATE_US = 300.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact of the host. verdict: pass or warn; advice: what would help, empty on pass."""

    name: str
    value: str
    verdict: str
    advice: str = ""


def host_findings() -> list[Finding]:
    """Look at scheduler, memory lock, timer, kernel and CPU governor. Takes about half a second."""
    with realtime_thread() as obtained:
        late_us = _timer_lateness_us()
    late = float(np.percentile(late_us, 99))
    realtime = _REALTIME_KERNEL.exists() and _REALTIME_KERNEL.read_text().strip() == "1"
    governor = _GOVERNOR.read_text().strip() if _GOVERNOR.exists() else "not reported"
    return [
        _finding(
            "scheduler", f"{obtained.scheduler} {obtained.priority}", obtained.scheduler == "fifo",
            "allow SCHED_FIFO: `rtprio 99` for this user in /etc/security/limits.conf",
        ),
        _finding(
            "memory lock", "locked" if obtained.memory_locked else "refused", obtained.memory_locked,
            "allow mlockall: `memlock unlimited` for this user in /etc/security/limits.conf",
        ),
        _finding(
            "timer", f"{late:.0f} us late at p99, {late_us.max():.0f} us at most", late < _LATE_US,
            "the host is busy, or a virtual machine: keep it for the loop alone",
        ),
        _finding(
            "kernel", f"{platform.release()}{', real-time' if realtime else ''}", realtime,
            "not a PREEMPT_RT kernel: good for the simulated robot, not for a real one",
        ),
        _finding(
            "CPU governor", governor, governor in ("performance", "not reported"),
            "set it to performance: `cpupower frequency-set -g performance`",
        ),
    ]  # fmt: skip


def _finding(name: str, value: str, good: bool, advice: str) -> Finding:
    return Finding(name, value, "pass" if good else "warn", "" if good else advice)


def _timer_lateness_us() -> np.ndarray:
    """Lateness of 1 ms sleeps against absolute deadlines, (n,) us."""
    late = np.empty(_TIMER_SAMPLES)
    deadline_ns = time.monotonic_ns()
    for k in range(_TIMER_SAMPLES):
        deadline_ns = max(deadline_ns + 1_000_000, time.monotonic_ns())
        time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
        late[k] = max(0, time.monotonic_ns() - deadline_ns) * 1e-3
    return late
