"""The link to the softly held arms: from a state to its answer, from an answer to its state, and how many in time."""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from hal.base.realtime import realtime_thread
from hal.cell import Cell
from hal.cycle import CYCLE, WORK, Cycles
from hal.host_work import HostWork
from rtstack.bench.hold import Hold, HoldEnded
from rtstack.log.analysis.lateness import Lateness, lateness
from rtstack.loop.session import StopSignal
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import safety_judges
from rtstack.trials.tightening import limits_of_arms

# libfranka, examples/communication_test.cpp: below the first many packets are lost, below the second it is not enough
GOOD_SUCCESS, ENOUGH_SUCCESS = 0.95, 0.90
_MASKS = ((), (0,), (1,), (0, 1))
_SETTLE = 100  # ticks: control_command_success_rate covers the last 100
STATE = np.dtype([("t_ns", "i8"), ("control_command_success_rate", "f8")])


class CycleLog:
    """Room for so many cycles of each arm. cycles: None where they are not measured. work: of the host, open."""

    def __init__(self, cycles: Sequence[Cycles] | None, work: HostWork, ticks: int, sides: Sequence[str]) -> None:
        self._sides, arms = sides, len(cycles or ())
        self._cycles, self._work, self._room = cycles, work, ticks
        self._kept, self._states = np.zeros((arms, ticks), CYCLE), np.zeros((arms, ticks), STATE)
        self._host = np.zeros(arms * ticks, WORK)
        self._count, self._read = [0] * arms, 0

    def take(self, side: int, t_ns: int, success_rate: float) -> None:
        """Take the cycle of an arm that was just answered, beyond the room nothing."""
        if self._cycles is None or self._count[side] >= self._room:
            return
        n = self._count[side]
        self._count[side] = n + 1
        self._kept[side, n] = self._cycles[side].sample[0]
        self._kept["t_ns"][side, n] = t_ns
        self._states[side, n] = t_ns, success_rate
        if self._work.cycle(self._cycles[side].late):
            self._host[self._read] = self._work.sample[0]
            self._read += 1

    def lateness(self) -> Lateness | None:
        """Return who was late, by the first arm's clock; None where cycles are not measured."""
        if self._cycles is None or min(self._count) == 0:
            return None
        kept, states = ([rows[k, :n] for k, n in enumerate(self._count)] for rows in (self._kept, self._states))
        ahead_ns = kept[-1]["t_ns"][0] - kept[0]["t_ns"][0]
        for rows in (kept, states):
            rows[-1]["t_ns"] -= ahead_ns
        return lateness(kept, states, self._host[: self._read], self._sides)


@dataclass(frozen=True, slots=True)
class LinkBenchmark:
    """Per arm, left before right. answer_us: from reading a state to its answer being sent. round_trip_us: from an
    answer to the arrival of the next state, in lockstep the wire, the robot and back; in real time what is left of a
    period. hold_rad, hold_rad_s, hold_nm: how far, how fast and with how much torque any joint was held.
    tau_ext_mean_nm and tau_ext_sd_nm: of each joint's external torque, O_F_ext_mean: of the wrench (6,) in the base, N
    and Nm, as the robots estimate them meanwhile. lateness: who was late, None in lockstep.
    """

    cell: str
    ticks: int
    scheduler: str
    success_rate_mean: tuple[float, ...]
    success_rate_min: tuple[float, ...]
    missed_states: tuple[int, ...]
    answer_us_p50: tuple[float, ...]
    answer_us_p99: tuple[float, ...]
    round_trip_us_p50: tuple[float, ...]
    round_trip_us_p99: tuple[float, ...]
    period_us_p50: float
    period_us_p99: float
    period_us_max: float
    hold_rad: tuple[float, ...]
    hold_rad_s: tuple[float, ...]
    hold_nm: tuple[float, ...]
    tau_ext_mean_nm: tuple[list[float], ...]
    tau_ext_sd_nm: tuple[list[float], ...]
    O_F_ext_mean: tuple[list[float], ...]
    lateness: Lateness | None = None

    @property
    def verdict(self) -> str:
        """Return pass, warn or fail, by the worse arm's mean success rate."""
        worst = min(self.success_rate_mean)
        return "pass" if worst >= GOOD_SUCCESS else "warn" if worst >= ENOUGH_SUCCESS else "fail"

    def as_dict(self) -> dict[str, object]:
        lateness = None if self.lateness is None else self.lateness.as_dict()
        return {**asdict(replace(self, lateness=None)), "lateness": lateness, "verdict": self.verdict}


def bench_link(
    cell: Cell, ticks: int, description: CellDescription, stop: StopSignal | None = None, record: Path | None = None
) -> LinkBenchmark:
    """Hold the arms for `ticks` ms, and stop them. They may be anywhere: the judges look at no box.

    record: an npz file for the samples by side, whatever came out. Raises ArmMoved, HoldEnded where `stop` was asked
    for, with the arms stopped, and HardwareError when the link breaks.
    """
    holds = _holds(description, ticks)
    try:
        with realtime_thread() if cell.own_clocks else nullcontext() as obtained:
            return _run(cell, ticks, holds, obtained.scheduler if obtained else "other", stop)
    finally:
        if record is not None:
            samples = {side: hold.samples for side, hold in zip(cell.sides, holds, strict=True)}
            np.savez_compressed(record, allow_pickle=False, **samples)


def _holds(description: CellDescription, ticks: int) -> tuple[Hold, ...]:
    wide = tuple(replace(one, ee_lower=(-inf,) * 3, ee_upper=(inf,) * 3) for one in limits_of_arms(description))
    arms = zip(description.sides, safety_judges(description, wide), wide, strict=True)
    return tuple(Hold(side, judge, limits, ticks) for side, judge, limits in arms)


def _run(cell: Cell, ticks: int, holds: tuple[Hold, ...], scheduler: str, stop: StopSignal | None) -> LinkBenchmark:
    arms, clock = cell.arms, time.perf_counter_ns
    count, together = [0] * len(arms), tuple(range(len(arms)))
    stamps, arrived, answered, rates = (np.zeros((len(arms), ticks)) for _ in range(4))
    with HostWork() as work:
        cycles = CycleLog(cell.cycles, work, ticks, cell.sides)
        try:
            cell.start()
            while min(count) < ticks:
                if stop is not None and stop.stop_requested:
                    raise HoldEnded("the hold was ended before its time: the key was let go, or a stop was asked for")
                for k in _MASKS[cell.link.wait()] if cell.own_clocks and cell.link is not None else together:
                    state = arms[k].read()
                    now_ns = clock()
                    arms[k].write(holds[k].torque(state))
                    n = count[k]
                    if n < ticks:
                        arrived[k, n], answered[k, n] = now_ns, clock()
                        stamps[k, n], rates[k, n] = state.t_ns, state.record["control_command_success_rate"][0]
                        cycles.take(k, state.t_ns, rates[k, n])
                        count[k] = n + 1
        finally:  # before anything is computed: a robot waits 20 ms for an answer
            cell.stop(at_rest=True)
    answer_us = (answered - arrived) * 1e-3
    round_trip_us = (arrived[:, 1:] - answered[:, :-1]) * 1e-3
    period_us = np.diff(arrived[0]) * 1e-3
    rates = rates[:, min(_SETTLE, ticks // 2) :]
    missed = (np.diff(stamps, axis=1)[:, 1:] > 1.5e6).sum(axis=1)
    return LinkBenchmark(
        cell=cell.name,
        ticks=ticks,
        scheduler=scheduler,
        success_rate_mean=_rounded(rates.mean(axis=1)),
        success_rate_min=_rounded(rates.min(axis=1)),
        missed_states=tuple(missed.tolist()),
        answer_us_p50=_rounded(np.percentile(answer_us, 50, axis=1)),
        answer_us_p99=_rounded(np.percentile(answer_us, 99, axis=1)),
        round_trip_us_p50=_rounded(np.percentile(round_trip_us, 50, axis=1)),
        round_trip_us_p99=_rounded(np.percentile(round_trip_us, 99, axis=1)),
        period_us_p50=round(float(np.percentile(period_us, 50)), 1),
        period_us_p99=round(float(np.percentile(period_us, 99)), 1),
        period_us_max=round(float(period_us.max()), 1),
        hold_rad=_rounded([hold.rad for hold in holds]),
        hold_rad_s=_rounded([hold.rad_s for hold in holds]),
        hold_nm=_rounded([hold.nm for hold in holds]),
        tau_ext_mean_nm=_rounded([hold.estimate[:, :7].mean(axis=0) for hold in holds]),
        tau_ext_sd_nm=_rounded([hold.estimate[:, :7].std(axis=0) for hold in holds]),
        lateness=cycles.lateness(),
        O_F_ext_mean=_rounded([hold.estimate[:, 7:].mean(axis=0) for hold in holds]),
    )


def _rounded(values: Sequence[float] | Sequence[np.ndarray] | np.ndarray) -> tuple[Any, ...]:
    return tuple(np.round(values, 4).tolist())
