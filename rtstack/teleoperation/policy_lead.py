"""What a policy asks for, by the tick: its newest answer out of the mailbox, and how long that is good for.

An answer that is no answer, is of another lease or comes too late counts for nothing, and is no sign of life.
"""

from collections.abc import Callable

import numpy as np

from hal.compilation import compiled
from rtstack.loop.end import End
from rtstack.loop.mailbox import CHUNK, CHUNK_POSES, Mailbox
from rtstack.loop.watchdogs import CLUTCH_S, WatchdogTrip

_LATE_NS = round(CLUTCH_S * 1e9)  # what answers a state that is older is not followed


@compiled
def _usable(chunk):
    """Whether every number of a chunk that is to be followed is one."""
    c = chunk[0]
    if c.count < 1 or c.count > CHUNK_POSES or c.step_ns < 1:
        return False
    for k in range(c.count):
        for side in range(2):
            for i in range(7):
                if not np.isfinite(c.pose[k, side, i]):
                    return False
    return True


@compiled
def _asked(chunk, began_ns, begin, now_ns, poses):
    """Write the poses (2, 7) of now: from `begin` (2, 7), of when the chunk came, on to its last one, which is kept."""
    c = chunk[0]
    due = c.observed_ns + c.step_ns
    k = -1
    share = 0.0
    if now_ns >= due:
        steps = (now_ns - due) / c.step_ns
        k = min(int(steps), c.count - 1)
        share = min(steps - k, 1.0) if k < c.count - 1 else 0.0
    elif due > began_ns:
        share = max(0.0, (now_ns - began_ns) / (due - began_ns))
    for side in range(2):
        square = 0.0
        sign = 0.0
        for i in range(3, 7):
            before = begin[side, i] if k < 0 else c.pose[k, side, i]
            sign += before * c.pose[min(k + 1, c.count - 1), side, i]
        for i in range(7):
            before = begin[side, i] if k < 0 else c.pose[k, side, i]
            after = c.pose[min(k + 1, c.count - 1), side, i]
            if i >= 3 and sign < 0.0:  # the shorter turn
                after = -after
            poses[side, i] = (1.0 - share) * before + share * after
            if i >= 3:
                square += poses[side, i] ** 2
        for i in range(3, 7):
            poses[side, i] /= np.sqrt(square)


def quiet(quiet_ns: int, end: End, lacking: str) -> WatchdogTrip | None:
    """Return why a session ends whose lead has been quiet for so long, None where that is allowed."""
    if (quiet_s := quiet_ns * 1e-9) <= CLUTCH_S:
        return None
    detail = f"no {lacking} for {quiet_s:.3g} s (limit {CLUTCH_S:g} s)"
    return WatchdogTrip(end, detail, value=quiet_s, bound=CLUTCH_S)


class PolicyLead:
    """The answers of a policy under a lease.

    poses (2, 7): what is asked of (left, right); xi (2,): of the posture, rad or NaN. clock: the host's monotonic time,
    ns.
    """

    def __init__(self, mailbox: Mailbox, job: int, clock: Callable[[], int]) -> None:
        self.lease = 0  # none
        self.answers = 0  # under this lease
        self.poses = np.zeros((2, 7))
        self.xi = np.full(2, np.nan)
        self._mailbox, self._job, self._clock = mailbox, job, clock
        self._chunk, self._read = np.zeros(1, CHUNK), np.zeros(1, CHUNK)
        self._begin = np.zeros((2, 7))
        self._began_ns = self._beat_ns = self._sequence = 0
        self._read["count"] = self._read["step_ns"] = 1
        self._read["pose"][0, :, :, 3] = self._begin[:, 3] = 1.0
        _usable(self._read)  # compiled before the first tick
        _asked(self._read, 0, self._begin, 0, self.poses)

    def begin(self, lease: int) -> None:
        """Follow a lease from now on; the first answer may take as long as any other one."""
        self.lease, self.answers, self._beat_ns = lease, 0, self._clock()
        self._sequence = 0  # an answer may be there already

    def end(self) -> None:
        """Follow no lease any more."""
        self.lease = 0
        self.xi[:] = np.nan

    def follow(self, now_ns: int, command: np.ndarray) -> bool:
        """Take a new answer and write `poses`; return whether there is one. command (2, 7): what is asked without."""
        if self._mailbox.chunk_sequence != self._sequence:
            self._take(now_ns, command)
        if not self.answers:
            return False
        _asked(self._chunk, self._began_ns, self._begin, now_ns, self.poses)
        k = (now_ns - int(self._chunk["observed_ns"][0])) // int(self._chunk["step_ns"][0]) - 1
        self.xi[:] = self._chunk["xi"][0, min(max(k, 0), int(self._chunk["count"][0]) - 1)]
        return True

    def trip(self) -> WatchdogTrip | None:
        """Return why a session ends whose policy is quiet, None while it is not."""
        return quiet(self._clock() - self._beat_ns, End.POLICY_QUIET, "answer that can be followed")

    def _take(self, now_ns: int, command: np.ndarray) -> None:
        sequence, read = self._mailbox.chunk_sequence, self._read
        if not self._mailbox.read_chunk(read):
            return
        self._sequence = sequence
        new = read[0]
        if new["job"] != self._job or new["lease"] != self.lease or not _usable(read):
            return
        if not 0 <= now_ns - new["observed_ns"] <= _LATE_NS:
            return
        self._begin[:] = self.poses if self.answers else command
        self._began_ns, self._beat_ns = now_ns, int(new["beat_ns"])
        self._chunk, self._read = read, self._chunk
        self.answers += 1
