"""The time of a session: each arm's own clock since its first state, and how the host keeps up with it."""

import numpy as np
from numpy.typing import NDArray

TICK_NS = 1_000_000
PAUSE_NS = 5 * TICK_NS  # ours: the robot bridges it with the last torque, and gives up after 20 ms


class Timeline:
    """Times of one session. Arms by their place among the arms; all times are ns of int. own_clocks: control boxes that
    count from anywhere. The second one's stamps are moved onto the first one's time line by the difference of their
    first states. `skew_ns`: the largest distance of the arms' newest states since. from_zero: all arms are of one robot
    that waits for its answer. How long it was idle before is the host's doing, so that stamps are moved to count from
    the first state."""

    def __init__(self, timing: NDArray[np.void], own_clocks: bool, from_zero: bool = False, arms: int = 2) -> None:
        """timing: the TIMING_SAMPLE (1,) to keep."""
        self.start_ns = -1  # robot's time of the first state
        self.t_ns = 0  # robot's time of the newest state
        self.elapsed_ns = [-1] * arms
        self.now_ns = -1  # time since the start of the reference
        self.skew_ns = 0
        self.pause_ns = 0  # the longest time without an answer since it was set to 0, from PAUSE_NS on
        # views of single fields: looking a field up costs more than writing it
        self._stamp, self._period_us, self._lateness_us, self._missed_deadlines, self._pair_skew_us = (
            timing[name] for name in ("t_ns", "period_us", "lateness_us", "missed_deadlines", "pair_skew_us")
        )
        self._arrived_ns = [0] * arms
        self._own_clocks, self._from_zero = own_clocks, from_zero
        self._starts = [0] * arms
        self._offsets = [0] * arms
        self._missed = [0] * arms
        self._host_start_ns = self._host_ns = 0

    @property
    def origin_ns(self) -> int:
        """Robot's time that the stamps count from: 0 where they are the robot's own."""
        return -self._offsets[0] if self._from_zero else 0

    @property
    def all_begun(self) -> bool:
        """Whether each arm has shown a state."""
        return min(self.elapsed_ns) >= 0

    @property
    def missed(self) -> int:
        """States of one of the arms that were not answered."""
        return max(self._missed)

    @property
    def real_time_factor(self) -> float:
        """Robot's seconds over the host's, from the first tick to the last."""
        return max(0, self.t_ns - self.start_ns) / max(1, self._host_ns - self._host_start_ns)

    def take(self, side: int, stamps: NDArray[np.int64], host_ns: int) -> None:
        """Take the stamp (1,) of a new state of an arm; it is moved onto the common time line in place."""
        t_ns = stamps.item()
        last_ns = self.elapsed_ns[side]
        if last_ns < 0:
            self._begin(side, t_ns, host_ns)
        elif last_ns == 0 and not self._own_clocks:
            # a robot that waits for us may have shown its first state several times before our first answer
            self._starts[side] = t_ns - TICK_NS
            self._note_start()
        elapsed_ns = self.elapsed_ns[side] = t_ns - self._starts[side]
        self.now_ns = max(self.elapsed_ns)
        if last_ns >= 0 and elapsed_ns - last_ns > TICK_NS:
            self._missed[side] += max(0, round((elapsed_ns - last_ns) / TICK_NS) - 1)
            if elapsed_ns - last_ns >= PAUSE_NS:
                self.pause_ns = max(self.pause_ns, elapsed_ns - last_ns)
        if self._own_clocks:
            self._take_own(side, stamps, t_ns, host_ns)
        elif self._from_zero:
            stamps[0] = elapsed_ns
        if side == 0:
            self._keep_up(t_ns, last_ns >= 0, host_ns)

    def _take_own(self, side: int, stamps: NDArray[np.int64], t_ns: int, host_ns: int) -> None:
        stamps[0] = t_ns + self._offsets[side]
        self._arrived_ns[side] = host_ns
        if self.all_begun:
            self._pair_skew_us[0] = abs(self._arrived_ns[0] - self._arrived_ns[-1]) * 1e-3
        if side == 1:
            self.skew_ns = max(self.skew_ns, abs(self.elapsed_ns[1] - self.elapsed_ns[0]))

    def _begin(self, side: int, t_ns: int, host_ns: int) -> None:
        self._starts[side] = t_ns
        if self.start_ns < 0:
            self.start_ns = t_ns
            self._host_start_ns = self._host_ns = host_ns
        if self._own_clocks:
            self._offsets[side] = self.start_ns - t_ns
        elif self._from_zero:
            self._note_start()

    def _note_start(self) -> None:
        self.start_ns = 0 if self._from_zero else self._starts[0]
        if self._from_zero:
            self._offsets[0] = -self._starts[0]

    def _keep_up(self, t_ns: int, going: bool, host_ns: int) -> None:
        self.t_ns = t_ns + self._offsets[0]
        self._stamp[0] = self.t_ns
        if going:
            self._period_us[0] = (host_ns - self._host_ns) * 1e-3
            late_ns = (host_ns - self._host_start_ns) - (self.t_ns - self.start_ns)
            self._lateness_us[0] = max(0.0, late_ns * 1e-3)
        self._missed_deadlines[0] = max(self._missed)
        self._host_ns = host_ns
