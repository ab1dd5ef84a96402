"""Relates two clocks by messages that carry the time of one and are stamped with the other one on arrival.

Of each block of messages the one that was delayed least counts, and a straight line through these gives offset and
drift. The least delay itself belongs to the offset. After a step of either clock the relation begins anew.
"""

from math import sqrt

import numpy as np

from hal.compilation import bound, compiled

BLOCK_NS = 500_000_000
BLOCKS = 40  # 20 s
_RATE_MAX = 1e-3  # no clock of a computer drifts by more: quartz has 100 ppm at most
_SLOPE_BLOCKS = 8  # before these the drift is taken as none: jitter would be taken for it
_STEP_NS = 100e6  # a message that is further off than this, or earlier, is from another time
_STEP_BLOCK_NS = 3e6  # a block's least delayed message that is further off, twice
_STEPS = 5  # so many messages one after the other
_LATE_NS = 1_000_000_000  # and, of messages that come later than they should, for so long: a network may hold some up
_ENOUGH = 20  # of so many messages one was hardly delayed: of 20 ms of jitter, by less than 3 ms with 96 %

RELATION = np.dtype(
    [
        ("samples", "i8"), ("first_a", "i8"), ("first_b", "i8"), ("blocks", "i8"), ("steps", "i8"), ("odd", "i8"),
        ("odd_since", "i8"), ("early", "i8"), ("late", "i8"),
        ("block_end", "f8"), ("least_a", "f8"), ("least_d", "f8"), ("offset", "f8"), ("slope", "f8"), ("rms", "f8"),
        ("a", "f8", (BLOCKS,)), ("d", "f8", (BLOCKS,)), ("resets", "i8"),
    ]
)  # fmt: skip


@compiled
def _begin(memory, a_ns, b_ns):
    r = memory[0]
    r.first_a, r.first_b = a_ns, b_ns
    r.samples, r.blocks, r.steps, r.odd, r.early, r.late = 1, 0, 0, 0, 0, 0
    r.block_end, r.least_a, r.least_d = BLOCK_NS, 0.0, 0.0
    r.offset, r.slope, r.rms = 0.0, 0.0, 0.0


@compiled
def _fit(memory):
    r = memory[0]
    n = min(r.blocks, BLOCKS)
    mean_a, mean_d = 0.0, 0.0
    for k in range(n):
        mean_a += r.a[k] / n
        mean_d += r.d[k] / n
    slope = 0.0
    if n >= _SLOPE_BLOCKS:
        saa, sad = 0.0, 0.0
        for k in range(n):
            saa += (r.a[k] - mean_a) ** 2
            sad += (r.a[k] - mean_a) * (r.d[k] - mean_d)
        slope = max(-_RATE_MAX, min(_RATE_MAX, sad / saa))
    squares = 0.0
    for k in range(n):
        squares += (r.d[k] - mean_d - slope * (r.a[k] - mean_a)) ** 2
    r.slope, r.offset, r.rms = slope, mean_d - slope * mean_a, sqrt(squares / n)


@compiled
def _off_line(r):
    """Return from which delay on, to either side of the line, a message is not one of the least delayed."""
    return _STEP_BLOCK_NS + 5.0 * r.rms


@compiled
def _close_block(memory):
    r = memory[0]
    off = abs(r.least_d - r.offset - r.slope * r.least_a)
    if r.blocks >= 2 and off > _off_line(r):
        r.odd += 1
        if r.odd < 2:
            return  # the next block says whether it was a step, or all of its messages were late
        r.blocks = 0  # what was before a step says nothing any more
        r.resets += 1
        r.late = 0
    r.odd, r.early = 0, 0
    k = r.blocks % BLOCKS
    r.a[k], r.d[k] = r.least_a, r.least_d
    r.blocks += 1
    _fit(memory)


@compiled
def _update(memory, a_ns, b_ns):
    """Take a message: a_ns as it says, b_ns on arrival."""
    r = memory[0]
    if r.samples == 0:
        _begin(memory, a_ns, b_ns)
        return
    a = float(a_ns - r.first_a)
    d = float(b_ns - r.first_b) - a
    late = d - r.offset - r.slope * a
    if abs(late) > _STEP_NS:
        if r.steps == 0:
            r.odd_since = b_ns
        r.steps += 1
        if r.steps >= _STEPS and (late < 0.0 or b_ns - r.odd_since >= _LATE_NS):
            _begin(memory, a_ns, b_ns)
            r.resets += 1
        return
    r.steps = 0
    if r.blocks > 0 and late < -_off_line(r):
        r.early += 1  # nothing arrives before it was sent: a clock has stepped, and no block has to be waited for
        if r.early >= _STEPS:
            _begin(memory, a_ns, b_ns)
            r.resets += 1
            return
    r.late = r.late + 1 if late > _off_line(r) else 0
    r.samples += 1
    if a >= r.block_end:
        _close_block(memory)
        r.block_end = a + BLOCK_NS
        r.least_a, r.least_d = a, d
    elif d < r.least_d:
        r.least_a, r.least_d = a, d
    if r.blocks == 0 and d < r.offset:
        r.offset = d


class ClockRelation:
    """The relation of clock a, that messages carry, to clock b, by which they are stamped on arrival. Times in ns.

    Nothing here allocates, waits or raises: it may be used in the tick.
    """

    def __init__(self) -> None:
        self.memory = np.zeros(1, RELATION)
        self._record = self.memory[0]
        self.update = bound(_update, self.memory, later=(0, 0))  # of a_ns and b_ns of a message

    @property
    def known(self) -> bool:
        """Whether a message has arrived."""
        return bool(self._record["samples"] > 0)

    @property
    def sure(self) -> bool:
        """Whether the newest message's time can be told: enough messages have been compared, and neither did any come
        before the line allows, nor all of the last ones long after it, as after a step of a clock."""
        r = self._record
        enough = r["blocks"] > 0 or r["samples"] >= _ENOUGH
        return bool(enough and r["steps"] == 0 and r["early"] == 0 and r["late"] < _ENOUGH)

    @property
    def blocks(self) -> int:
        """How many blocks the line goes through, or has gone through since it began."""
        return int(self._record["blocks"])

    @property
    def resets(self) -> int:
        """How often it began anew, after a step of either clock."""
        return int(self._record["resets"])

    @property
    def drift_ppm(self) -> float:
        """By how much clock b is faster than clock a."""
        return 1e6 * float(self._record["slope"])

    @property
    def rms_ns(self) -> float:
        """How far the least delayed messages are off the line: the relation's uncertainty, without the least delay."""
        return float(self._record["rms"])

    def b_of(self, a_ns: int) -> int:
        """Return clock b's time at a time of clock a, as of the least delayed message."""
        r = self._record
        a = a_ns - int(r["first_a"])
        return int(r["first_b"]) + a + round(float(r["offset"]) + float(r["slope"]) * a)

    def a_of(self, b_ns: int) -> int:
        """Return clock a's time at a time of clock b."""
        r = self._record
        b = b_ns - int(r["first_b"])
        return int(r["first_a"]) + round((b - float(r["offset"])) / (1.0 + float(r["slope"])))
