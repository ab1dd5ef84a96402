"""One cycle of a loop that answers arms with clocks of their own: when a state came and when it was answered, and what
the host did meanwhile. `hal.fci.cycle_times` and `hal.host_work` measure it."""

from typing import Any, Protocol

from numpy.typing import NDArray

from hal.base.record import Field, record_of

CYCLE_FIELDS = (
    Field("arrived_us", "When the kernel got the oldest state that was not read, {unit} of the host's monotonic clock.",
          "us", host_clock=True),
    Field("unread", "States that had come by then, of which the newest was read.", kind="i8", host_clock=True),
    Field("free_us", "From the arrival to the end of the last cycle, {unit}; negative: the loop waited already.", "us",
          host_clock=True),
    Field("seen_us", "From the arrival until the loop looked, {unit}.", "us", host_clock=True),
    Field("read_us", "From the arrival until the newest state was read, {unit}.", "us", host_clock=True),
    Field("answered_us", "From the arrival until the answer was sent, {unit}.", "us", host_clock=True),
)  # fmt: skip
CYCLE = record_of(CYCLE_FIELDS)

WORK_FIELDS = (
    Field("at_us", "When this was read, {unit} of the host's monotonic clock.", "us", host_clock=True),
    Field("cycles", "Cycles since it was read before; all that follows counts from then.", kind="i8", host_clock=True),
    Field("cpu_us", "The loop's thread computed, {unit}.", "us", host_clock=True),
    Field("no_cpu_us", "It was ready and had no CPU, {unit}.", "us", host_clock=True),
    Field("others_us", "Other threads of its process computed, {unit}.", "us", host_clock=True),
    Field("collected_us", "Garbage was collected, {unit}.", "us", host_clock=True),
    Field("page_faults", "Pages that its thread touched for the first time.", kind="i8", host_clock=True),
    Field("pages_read", "Pages that were read from a disk for it.", kind="i8", host_clock=True),
)
WORK = record_of(WORK_FIELDS)


class Cycles(Protocol):
    """Measures the cycles of one arm: sample (1,) of CYCLE is the last one, without its t_ns; late: it was late."""

    sample: NDArray[Any]

    @property
    def late(self) -> bool:
        """Whether a state came late, was passed over, or was answered late."""
        ...
