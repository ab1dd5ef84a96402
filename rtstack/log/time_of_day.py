"""Time of day: how the robot's time of a log is UTC.

The log has the first and the last pair of both times in its metadata record `time`; of real arms /clock is more exact.
"""

import contextlib
import ctypes
import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtstack.topics import CLOCK_TOPIC

if TYPE_CHECKING:
    from rtstack.log.reader import Log

RECORD = "time"  # the metadata record
# The record lies in memory that two processes may share. pairs: the first and the newest. simulated: robot time is.
# opened_ns: Unix time of the log's opening. offset_ns: of Unix time to time.monotonic_ns, then
TIMES = np.dtype(
    [("simulated", "i8"), ("opened_ns", "i8"), ("offset_ns", "i8"),
     ("t_ns", "i8", (2,)), ("uncertainty_ns", "i8", (2,)), ("unix_ns", "i8", (2,))]
)  # fmt: skip
_AGE_NS = 2_000_000  # of the newest state: a later one comes after 1 ms, and the other arm's within 1 ms of it
_SET_NS = 1_000_000  # NTP slews both clocks alike: what changes their distance by more is a clock that was set
_TIME_ERROR = 5  # ntp_gettime(3): the clock is not synchronised
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class TimeOfDay:
    """Unix time of a log's times, a straight line through (t_ns, at_ns), both ns.

    rate: Unix time over the robot's. uncertainty_s: of the line at t_ns, without the host's own error. simulated: the
    robot's time is, and only the run's begin and end are known. Of the host's clock, None if unknown: synchronised;
    error_s, at most, as NTP estimates it; set_s: by how much it was set during the run.
    """

    t_ns: int
    at_ns: int
    rate: float
    uncertainty_s: float
    simulated: bool
    synchronised: bool | None = None
    error_s: float | None = None
    set_s: float = 0.0

    def unix_ns(self, t_ns: Any) -> Any:
        """Return the Unix time, ns, of a time of the log, ns: int, or an array of them."""
        since_ns = np.asarray(t_ns, np.int64) - self.t_ns
        unix_ns = self.at_ns + since_ns + np.rint((self.rate - 1.0) * since_ns).astype(np.int64)
        return int(unix_ns) if np.ndim(t_ns) == 0 else unix_ns

    def utc(self, t_ns: int) -> datetime:
        """Return the time of day, UTC, of a time of the log, ns."""
        return _EPOCH + timedelta(microseconds=self.unix_ns(t_ns) // 1000)


def time_of_day(log: "Log") -> TimeOfDay | None:
    """Return how a log's times are UTC; None for a log that does not have it: of an older version, without a tick, or
    with a record that cannot be read. Raises LogError."""
    with contextlib.suppress(KeyError, ValueError, TypeError, OverflowError):
        return _said(log)
    return None


def _said(log: "Log") -> TimeOfDay | None:
    said = log.metadata.get(RECORD, {})
    set_s, clock, error = (said.get(key) for key in ("clock_set_s", "clock", "clock_error_s"))
    set_s, known = float(set_s or 0.0), None if clock is None else clock == "synchronised"
    host = known, None if error is None else float(error), set_s
    if exact := log.times(CLOCK_TOPIC):
        last = log.between([CLOCK_TOPIC], exact[-1], exact[-1])[CLOCK_TOPIC][-1]
        rate, uncertainty_s = 1.0 + 1e-6 * float(last["drift_ppm"]), 1e-6 * float(last["uncertainty_us"])
        return TimeOfDay(exact[-1], int(last["unix_ns"]), rate, uncertainty_s, False, *host)
    if "t_ns" not in said:
        return None
    t_ns, unix_ns = int(said["t_ns"]), unix_of(said["utc"]) + round(1e9 * set_s)
    simulated, rate = said["robot_time"] == "simulated", 1.0
    if simulated and int(said.get("end_t_ns", t_ns)) > t_ns:
        rate = (unix_of(said["end_utc"]) - unix_ns) / (int(said["end_t_ns"]) - t_ns)
    return TimeOfDay(t_ns, unix_ns, rate, float(said["utc_uncertainty_s"]), simulated, *host)


def iso(unix_ns: int) -> str:
    """Return a Unix time, ns, as ISO 8601 has it, UTC, to the microsecond."""
    return f"{_EPOCH + timedelta(microseconds=int(unix_ns) // 1000):%Y-%m-%dT%H:%M:%S.%fZ}"


def unix_of(text: str) -> int:
    """Return the Unix time, ns, of a time as ISO 8601 has it. Raises ValueError."""
    return (datetime.fromisoformat(text) - _EPOCH) // timedelta(microseconds=1) * 1000


def begun(times: NDArray[np.void], simulated: bool) -> NDArray[np.void]:
    """Begin with a log's TIMES (1,), and return them."""
    times["simulated"], times["opened_ns"], times["offset_ns"] = simulated, time.time_ns(), _offset_ns()
    return times


def take_pair(times: NDArray[np.void], t_ns: int, compute_us: float) -> None:
    """Pair the newest state's time with the host's clock, between two ticks. compute_us: since that state was read.

    It is at least that old, and at most so much more that the next one has not come. Never waits.
    """
    before_ns, unix_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    half_ns = round(500.0 * compute_us) + (0 if times["simulated"][0] else _AGE_NS // 2)
    k = 1 if times["unix_ns"][0, 0] else 0
    times["t_ns"][0, k], times["uncertainty_ns"][0, k] = t_ns, half_ns + (after_ns - before_ns) // 2
    times["unix_ns"][0, k] = unix_ns - half_ns  # last: the log process looks for it


def time_record(times: NDArray[np.void], ended: bool = False) -> dict[str, str]:
    """Return the metadata record of a log's TIMES (1,): of its begin, and of its end too once it has ended."""
    found = times[0]
    said = {"utc": iso(found["opened_ns"]), "robot_time": "simulated" if found["simulated"] else "own clock"}
    for k, prefix in enumerate(("", "end_") if ended else ("",)):
        if unix_ns := found["unix_ns"][k]:
            said |= {f"{prefix}utc": iso(unix_ns), f"{prefix}t_ns": str(found["t_ns"][k])}
            said[f"{prefix}utc_uncertainty_s"] = f"{1e-9 * found['uncertainty_ns'][k]:.9f}"
    said |= _synchronised()
    if ended:
        set_ns = _offset_ns() - int(found["offset_ns"])
        said["clock_set_s"] = f"{1e-9 * set_ns:.6f}" if abs(set_ns) > _SET_NS else "0.0"
    return said


def _offset_ns() -> int:
    """Return by how much Unix time is more than the monotonic one's: of five readings, that which took least."""
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(5)]
    before_ns, unix_ns, after_ns = min(readings, key=lambda each: each[2] - each[0])
    return unix_ns - (before_ns + after_ns) // 2


def _synchronised() -> dict[str, str]:
    """Return whether the host's clock is synchronised, and its largest error, s; nothing where that is not known."""

    class Ntp(ctypes.Structure):  # struct ntptimeval of <sys/timex.h>
        _fields_ = [(name, ctypes.c_long) for name in ("s", "us", "maxerror", "esterror", "tai", *"abcd")]

    said = Ntp()
    try:
        state = ctypes.CDLL(None).ntp_gettime(ctypes.byref(said))
    except (OSError, AttributeError):
        state = -1
    if state == _TIME_ERROR:
        return {"clock": "not synchronised"}
    return {} if state < 0 else {"clock": "synchronised", "clock_error_s": f"{1e-6 * said.maxerror:.6f}"}
