"""When each millisecond of a robot's clock begins, and until when an answer counts. No sockets: instants come in.

What a client may rely on is in docs/reference/simulated_robot.md (When a robot loses packets). Beyond it:
- A client that answered late delays a millisecond by one period at most: an answer later than 1 ms is lost.
- The server's own lateness of more than a period stops the clock, unless all awaited clients have been silent for
  LONGEST_SILENCE states. It is made up for while all have answered; beyond LARGEST_LAG_NS it is given up.
- A torque that is late, but within a ms of its state, counts for the next ms; a motion's point does not.
"""

PERIOD_NS = 1_000_000
# further behind than this, the robot's time slips instead of being caught up
LARGEST_LAG_NS = 50_000_000
# states in a row without an answer, after which it is the client that is silent, not the host that stalls both
LONGEST_SILENCE = 3


class Pace:
    """The instants of one clock, ns. ticks: milliseconds begun; slipped_ns: time that was given up."""

    def __init__(self, origin_ns: int, period_ns: float = PERIOD_NS) -> None:
        self.ticks = self.slipped_ns = self.lag_ns = 0
        self._origin_ns, self._period_ns, self._shown_ns = origin_ns, period_ns, origin_ns

    @property
    def _scheduled_ns(self) -> int:
        return self._origin_ns + round((self.ticks + 1) * self._period_ns)

    @property
    def deadline_ns(self) -> int:
        """When the next millisecond begins, with or without answers."""
        return self._scheduled_ns + self.lag_ns

    @property
    def window_ns(self) -> int:
        """Until when a client that answered the last state may answer the present one."""
        return max(self.deadline_ns, min(self._shown_ns, self.deadline_ns) + round(self._period_ns))

    def end_ns(self, awaited: bool, punctual: bool) -> int:
        """Return when the present millisecond ends. awaited: an answer is due; punctual: the last one came in time."""
        if not awaited:
            return self._scheduled_ns  # what the clock stood still is made up for
        return self.window_ns if punctual else self.deadline_ns

    def begin(self, now_ns: int) -> None:
        self.lag_ns = max(0, min(self.lag_ns, now_ns - self._scheduled_ns))
        self.ticks += 1

    def show(self, now_ns: int) -> None:
        """Note that this millisecond's states have gone out."""
        self._shown_ns = now_ns

    def stand_still(self, late_ns: int) -> None:
        """Let the clock stand still, since the server was late by so much."""
        self.lag_ns += late_ns
        if self.lag_ns > LARGEST_LAG_NS:
            self._origin_ns += self.lag_ns
            self.slipped_ns += self.lag_ns
            self.lag_ns = 0
