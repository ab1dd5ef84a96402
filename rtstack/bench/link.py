"""The link to the arms: how long a state takes to its answer and an answer to its state, and how many come in time.

The arms are held softly where they are, under their judges (`bench/hold.py`): a robot should carry its own weight, and
is not believed.
"""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from math import inf

import numpy as np

from hal.cell import Cell
from hal.realtime import realtime_thread
from rtstack.bench.cycle_log import CycleLog
from rtstack.bench.hold import Hold, HoldEnded
from rtstack.log.lateness import Lateness
from rtstack.loop.session import StopSignal
from rtstack.model.cell_description import CellDescription
from rtstack.samples import SIDES
from rtstack.trials.assembly import safety_judges
from rtstack.trials.tightening import limits_of_arms

# libfranka, examples/communication_test.cpp: below the first many packets are lost, below the second it is not enough
GOOD_SUCCESS, ENOUGH_SUCCESS = 0.95, 0.90
_MASKS = ((), (0,), (1,), (0, 1))
_SETTLE = 100  # ticks: control_command_success_rate covers the last 100


@dataclass(frozen=True, slots=True)
class LinkBenchmark:
    """Per arm (left, right). answer_us: from reading a state to its answer being sent. round_trip_us: from an answer to
    the arrival of the next state, in lockstep the wire, the robot and back; in real time what is left of a period.
    hold_rad, hold_rad_s, hold_nm: how far, how fast and with how much torque any joint was held. tau_ext_mean_nm and
    tau_ext_sd_nm: of each joint's external torque, O_F_ext_mean: of the wrench (6,) in the base, N and Nm, as the
    robots estimate them meanwhile. lateness: who was late, None in lockstep.
    """

    cell: str
    ticks: int
    scheduler: str
    success_rate_mean: tuple[float, float]
    success_rate_min: tuple[float, float]
    missed_states: tuple[int, int]
    answer_us_p50: tuple[float, float]
    answer_us_p99: tuple[float, float]
    round_trip_us_p50: tuple[float, float]
    round_trip_us_p99: tuple[float, float]
    period_us_p50: float
    period_us_p99: float
    period_us_max: float
    hold_rad: tuple[float, float]
    hold_rad_s: tuple[float, float]
    hold_nm: tuple[float, float]
    tau_ext_mean_nm: tuple[list[float], list[float]]
    tau_ext_sd_nm: tuple[list[float], list[float]]
    O_F_ext_mean: tuple[list[float], list[float]]
    lateness: Lateness | None = None

    @property
    def verdict(self) -> str:
        """Return pass, warn or fail, by the worse arm's mean success rate."""
        worst = min(self.success_rate_mean)
        return "pass" if worst >= GOOD_SUCCESS else "warn" if worst >= ENOUGH_SUCCESS else "fail"

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        lateness = None if self.lateness is None else self.lateness.as_dict()
        return {**asdict(replace(self, lateness=None)), "lateness": lateness, "verdict": self.verdict}


def bench_link(cell: Cell, ticks: int, description: CellDescription, stop: StopSignal | None = None) -> LinkBenchmark:
    """Hold both arms for `ticks` ms, and stop them. They may be anywhere: the judges look at no box.

    Raises ArmMoved where one does not stay and HoldEnded where `stop` was asked for, with both arms stopped, and
    HardwareError when the link breaks.
    """
    with realtime_thread() if cell.own_clocks else nullcontext() as obtained:
        try:
            return _run(cell, ticks, _holds(description, ticks), obtained.scheduler if obtained else "other", stop)
        finally:
            cell.stop(at_rest=True)


def _holds(description: CellDescription, ticks: int) -> tuple[Hold, ...]:
    left, right = (replace(one, ee_lower=(-inf,) * 3, ee_upper=(inf,) * 3) for one in limits_of_arms(description))
    judges = safety_judges(description, (left, right))
    return tuple(
        Hold(side, judge, limits, ticks) for side, judge, limits in zip(SIDES, judges, (left, right), strict=True)
    )


def _run(cell: Cell, ticks: int, holds: tuple[Hold, ...], scheduler: str, stop: StopSignal | None) -> LinkBenchmark:
    arms, clock = (cell.left, cell.right), time.perf_counter_ns
    count = [0, 0]
    stamps, arrived, answered, rates = (np.zeros((2, ticks)) for _ in range(4))
    cell.start()
    with CycleLog(cell.cycles, ticks) as cycles:
        while min(count) < ticks:
            if stop is not None and stop.stop_requested:
                raise HoldEnded("the hold was ended before its time: the key was let go, or a stop was asked for")
            for k in _MASKS[cell.link.wait()] if cell.own_clocks and cell.link is not None else (0, 1):
                state = arms[k].read()
                now_ns = clock()
                arms[k].write(holds[k].torque(state))
                n = count[k]
                if n < ticks:
                    arrived[k, n], answered[k, n] = now_ns, clock()
                    stamps[k, n], rates[k, n] = state.t_ns, state.record["control_command_success_rate"][0]
                    cycles.take(k, state.t_ns, rates[k, n])
                    count[k] = n + 1
    answer_us = (answered - arrived) * 1e-3
    round_trip_us = (arrived[:, 1:] - answered[:, :-1]) * 1e-3
    period_us = np.diff(arrived[0]) * 1e-3
    rates = rates[:, min(_SETTLE, ticks // 2) :]
    missed = (np.diff(stamps, axis=1)[:, 1:] > 1.5e6).sum(axis=1)
    return LinkBenchmark(
        cell=cell.name,
        ticks=ticks,
        scheduler=scheduler,
        success_rate_mean=_pair(rates.mean(axis=1)),
        success_rate_min=_pair(rates.min(axis=1)),
        missed_states=(int(missed[0]), int(missed[1])),
        answer_us_p50=_pair(np.percentile(answer_us, 50, axis=1)),
        answer_us_p99=_pair(np.percentile(answer_us, 99, axis=1)),
        round_trip_us_p50=_pair(np.percentile(round_trip_us, 50, axis=1)),
        round_trip_us_p99=_pair(np.percentile(round_trip_us, 99, axis=1)),
        period_us_p50=round(float(np.percentile(period_us, 50)), 1),
        period_us_p99=round(float(np.percentile(period_us, 99)), 1),
        period_us_max=round(float(period_us.max()), 1),
        hold_rad=_pair([hold.rad for hold in holds]),
        hold_rad_s=_pair([hold.rad_s for hold in holds]),
        hold_nm=_pair([hold.nm for hold in holds]),
        tau_ext_mean_nm=_lists([hold.estimate[:, :7].mean(axis=0) for hold in holds]),
        tau_ext_sd_nm=_lists([hold.estimate[:, :7].std(axis=0) for hold in holds]),
        lateness=cycles.lateness(),
        O_F_ext_mean=_lists([hold.estimate[:, 7:].mean(axis=0) for hold in holds]),
    )


def _lists(values: Sequence[np.ndarray]) -> tuple[list[float], list[float]]:
    left, right = (np.round(row, 4).tolist() for row in values)
    return left, right


def _pair(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    left, right = values
    return round(float(left), 4), round(float(right), 4)
