"""Who was late: each late cycle of a log is laid to the robot, the wire or the host. A pure function of its records.

A robot sends a state each millisecond of its clock, and takes an answer within one. The kernel's stamp of a state,
against a line through the least delayed ones, says how late it came; from there on it is the host's. A state that came
late was sent late (ROBOT), or was on its way (WIRE) while the robot counted milliseconds without an answer.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from rtstack.log.reader import Log
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, CYCLE_TOPICS, WORK_TOPIC

PERIOD_US = 1000.0
WORST = 10
_ONE_STALL_S = 5e-3  # between two late cycles of one stall
_WINDOW = 500  # cycles on each side through which the line of the least delayed states is drawn
_TOGETHER_US = 1200.0  # what a wire has held up comes within a cycle or two
_SEEN_BY = 20  # ms after which a state shows how many answers the robot has missed
_RATE_STATES = 100  # control_command_success_rate covers the last 100 (Franka Control Interface)
_PROMPT_US = 500.0  # an answer that left within this after its state had half of the robot's time for its way


class Blame(StrEnum):
    ROBOT = "ROBOT"
    WIRE = "WIRE"
    ROBOT_OR_WIRE = "ROBOT or WIRE"
    HOST = "HOST"


class HostCause(StrEnum):
    """What a host did while an answer was due."""

    NONE = ""
    COLLECTION = "garbage collection"
    NO_CPU = "had no CPU"
    PAGES = "page faults"
    TICK = "computing: this cycle"
    LAST_CYCLE = "computing: the cycle before"
    SOCKET = "computing: the socket"
    THREAD = "another thread of this process"
    STOPPED = "stopped, or waiting"


@dataclass(frozen=True, slots=True)
class LateCycle:
    """One late cycle. t_s: since the first one; late_us: from when the state was due to its answer.

    Parts, us: outside_us until the state came, then the host's: busy_us with the cycle before, wake_us until the loop
    looked, read_us for the socket, tick_us from the state to the answer. missing: states that never came; passed_over:
    that had come when a newer one was read; unanswered: ms that the robot has counted without an answer.
    """

    t_s: float
    side: str
    blame: Blame
    late_us: float
    outside_us: float
    busy_us: float
    wake_us: float
    read_us: float
    tick_us: float
    missing: int
    passed_over: int
    unanswered: int
    cause: HostCause
    page_faults: int = 0


@dataclass(frozen=True, slots=True)
class Lateness:
    """All late cycles of a run, in order of time, and how many cycles there were."""

    cycles: int
    late: tuple[LateCycle, ...]

    @property
    def shares(self) -> dict[str, int]:
        counts = Counter(cycle.blame.value for cycle in self.late)
        return {blame.value: counts[blame] for blame in Blame if counts[blame]}

    @property
    def causes(self) -> dict[str, int]:
        return dict(Counter(cycle.cause.value for cycle in self.late if cycle.blame is Blame.HOST).most_common())

    @property
    def stalls(self) -> tuple[LateCycle, ...]:
        """The latest cycle of each stall: late cycles of either arm, of one blame, one shortly after the other."""
        found: list[LateCycle] = []
        last: dict[Blame, tuple[float, int]] = {}  # when one was late last, and of which stall
        for cycle in self.late:
            last_s, k = last.get(cycle.blame, (-inf, -1))
            if cycle.t_s - 1e-6 * cycle.late_us - last_s > _ONE_STALL_S:
                k = len(found)
                found.append(cycle)
            else:
                found[k] = max(found[k], cycle, key=lambda one: one.late_us)
            last[cycle.blame] = cycle.t_s, k
        return tuple(found)

    @property
    def worst(self) -> tuple[LateCycle, ...]:
        """The latest cycles of the WORST stalls, the longest one first."""
        return tuple(sorted(self.stalls, key=lambda cycle: -cycle.late_us)[:WORST])

    @property
    def table(self) -> list[str]:
        """The worst cycles as lines of text, with a head; none where nothing was late."""
        if not self.late:
            return []
        head = ("t", "arm", "whose", "late ms", "outside us", "cycle before", "waking", "socket", "tick", "missing",
                "the host")  # fmt: skip
        rows = [
            (f"{one.t_s:.3f} s", one.side, str(one.blame), f"{1e-3 * one.late_us:.2f}", f"{one.outside_us:.0f}",
             f"{one.busy_us:.0f}", f"{one.wake_us:.0f}", f"{one.read_us:.0f}", f"{one.tick_us:.0f}",
             str(one.missing + one.passed_over), str(one.cause))
            for one in self.worst
        ]  # fmt: skip
        widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
        return ["  ".join(f"{word:<{width}}" for word, width in zip(row, widths, strict=True)).rstrip()
                for row in (head, *rows)]  # fmt: skip

    @property
    def line(self) -> str:
        if not self.late:
            return f"none of {self.cycles} cycles was late"
        shares = ", ".join(f"{count} {name}" for name, count in self.shares.items())
        causes = ", ".join(f"{count} {name}" for name, count in self.causes.items())
        worst = self.worst[0]
        return (
            f"{len(self.late)} of {self.cycles} cycles late, in {len(self.stalls)} stalls: {shares}"
            f"{f' ({causes})' if causes else ''}; the worst by {1e-3 * worst.late_us:.1f} ms, {worst.blame}"
        )

    def as_dict(self) -> dict[str, Any]:
        return {
            "cycles": self.cycles, "late": len(self.late), "stalls": len(self.stalls), "shares": self.shares,
            "causes": self.causes, "worst": [asdict(cycle) for cycle in self.worst], "line": self.line,
        }  # fmt: skip


def lateness_of(log: Log) -> Lateness | None:
    """Return who was late in a log, None where its arms had no clocks of their own. Raises LogError."""
    arms = {side: log.topic(topic) for side, topic in zip(SIDES, ARM_TOPICS, strict=True)}
    sides = [side for side, samples in arms.items() if len(samples)]
    cycles = [log.topic(CYCLE_TOPICS[SIDES.index(side)]) for side in sides]
    if not cycles or not all(map(len, cycles)):
        return None
    return lateness(cycles, [arms[side] for side in sides], log.topic(WORK_TOPIC), sides)


def lateness(
    cycles: Sequence[NDArray], arms: Sequence[NDArray], work: NDArray, sides: Sequence[str] = SIDES
) -> Lateness:
    """Return who was late. cycles: of CYCLE, of the arms of these sides; arms: of records with t_ns and
    control_command_success_rate; work: of WORK. All in order of time."""
    start_ns = min(int(one["t_ns"][0]) for one in cycles if len(one))
    late = [
        cycle
        for side, own, arm in zip(sides, cycles, arms, strict=True)
        for cycle in _late_cycles(side, own, arm, work, start_ns)
    ]
    return Lateness(sum(map(len, cycles)), tuple(sorted(late, key=lambda cycle: (cycle.t_s, cycle.side))))


def state_delays_us(cycles: NDArray) -> NDArray:
    """Return how much later than the least delayed states around it each state came, (n,) of CYCLE records (n,): of the
    least delays (the host's time of arrival minus the robot's) before and after it the larger one counts, as it was one
    state before, so that a clock that has stood still is late once."""
    delay_us = cycles["arrived_us"] - _oldest_us(cycles)
    before, after = (
        minimum_filter1d(delay_us, _WINDOW + 1, mode="nearest", origin=origin)
        for origin in (_WINDOW // 2, -_WINDOW // 2)
    )
    line = np.maximum(before, after)
    line[1:] = np.minimum(line[1:], line[:-1])
    return np.maximum(0.0, delay_us - line)


def _oldest_us(cycles: NDArray) -> NDArray:
    return 1e-3 * cycles["t_ns"] - PERIOD_US * np.maximum(0, cycles["unread"] - 1)


def _late_cycles(side: str, cycles: NDArray, arm: NDArray, work: NDArray, start_ns: int) -> list[LateCycle]:
    if not len(cycles):
        return []
    own_us = np.maximum(cycles["answered_us"], 0.0)
    passed_over = np.maximum(0, cycles["unread"] - 1)
    oldest_us, outside_us = _oldest_us(cycles), state_delays_us(cycles)
    missing = np.zeros(len(cycles))
    missing[1:] = np.maximum(0.0, np.round((oldest_us[1:] - 1e-3 * cycles["t_ns"][:-1]) / PERIOD_US) - 1.0)
    unanswered = _unanswered(cycles, arm)
    typical_us = float(np.median(own_us))
    late = (outside_us + own_us > PERIOD_US) | (missing > 0) | (passed_over > 0)
    late |= _lost_on_time(cycles["t_ns"], late, arm)
    late[0] = False  # the robot awaits no answer before the first one
    found: list[LateCycle] = []
    open_until, blame_outside = -1, Blame.ROBOT_OR_WIRE
    for k in np.flatnonzero(late).tolist():
        away_us = float(outside_us[k] + PERIOD_US * missing[k])
        excess_us = max(0.0, float(own_us[k]) - typical_us)
        counted = int(unanswered[k])
        cause, faults = HostCause.NONE, 0
        if excess_us > away_us and own_us[k] > _PROMPT_US:
            blame = Blame.HOST
            cause, faults = _cause(cycles[k], excess_us, work)
        else:
            # states that come late one after the other were held up once
            if k > open_until:
                blame_outside = _robot_or_wire(away_us, counted, float(own_us[k]))
            blame, open_until = blame_outside, k + 2
        busy_us = min(max(0.0, float(cycles["free_us"][k])), float(cycles["seen_us"][k]))
        found.append(LateCycle(
            t_s=1e-9 * (int(cycles["t_ns"][k]) - start_ns), side=side, blame=blame,
            late_us=round(away_us + float(own_us[k]), 1), outside_us=round(away_us, 1), busy_us=round(busy_us, 1),
            wake_us=round(float(cycles["seen_us"][k]) - busy_us, 1),
            read_us=round(float(cycles["read_us"][k] - cycles["seen_us"][k]), 1),
            tick_us=round(float(cycles["answered_us"][k] - cycles["read_us"][k]), 1), missing=int(missing[k]),
            passed_over=int(passed_over[k]), unanswered=counted, cause=cause, page_faults=faults,
        ))  # fmt: skip
    return found


def _unanswered(cycles: NDArray, arm: NDArray) -> NDArray:
    """Return how many answers the robot counts as missed from before each state to those that came with it, -1: not
    counted. A robot that stood still may miss answers afterwards, while it makes up for it."""
    t_ns, arrived_us = cycles["t_ns"], cycles["arrived_us"]
    rate = arm["control_command_success_rate"]
    if not len(arm) or not rate.any():
        return np.full(len(t_ns), -1)
    first = np.clip(np.searchsorted(arm["t_ns"], t_ns) - 1, 0, len(arm) - 1)
    together = np.searchsorted(arrived_us, arrived_us + _TOGETHER_US, side="right") - 1
    last = np.searchsorted(arm["t_ns"], t_ns[together], side="right")
    least = np.array([rate[a : max(b, a + 1)].min() for a, b in zip(first, last, strict=True)])
    return np.round(_RATE_STATES * np.maximum(0.0, rate[first] - least)).astype(int)


def _lost_on_time(t_ns: NDArray, late: NDArray, arm: NDArray) -> NDArray:
    """Return which cycles were in time, though the next states say that their answer was missed."""
    found = np.zeros(len(t_ns), dtype=bool)
    for t in arm["t_ns"][1:][np.diff(arm["control_command_success_rate"]) < -0.5 / _RATE_STATES]:
        k = int(np.searchsorted(t_ns, t)) - 1  # the cycle before the state that shows it
        near = late[max(0, np.searchsorted(t_ns, t - _SEEN_BY * 1_000_000)) : k + 2]
        if k >= 0 and not near.any():
            found[k] = True
    return found


def _robot_or_wire(away_us: float, counted: int, own_us: float) -> Blame:
    """Tell a late robot from a wire, by the milliseconds that the robot has counted without an answer. One that the
    host was late with, own_us after its state, may be among them."""
    passed, hosts = max(1, int(away_us / PERIOD_US)), int(np.ceil(own_us / PERIOD_US)) if own_us > _PROMPT_US else 0
    if counted < 0:
        return Blame.ROBOT_OR_WIRE
    if 2 * (counted - hosts) >= passed:
        return Blame.WIRE
    return Blame.ROBOT if 4 * counted <= passed else Blame.ROBOT_OR_WIRE


def _cause(cycle: np.void, excess_us: float, work: NDArray) -> tuple[HostCause, int]:
    """Return what the host did while it was late by excess_us, and how many pages were touched or read."""
    begun_us, ended_us = cycle["arrived_us"], cycle["arrived_us"] + cycle["answered_us"]
    first = int(np.searchsorted(work["at_us"], begun_us))
    last = int(np.searchsorted(work["at_us"], ended_us)) + 1  # what is read after the answer belongs to it
    own = work[first:last]
    if not len(own):
        return HostCause.STOPPED, 0
    usual_us = float(np.median(work["cpu_us"] / np.maximum(1, work["cycles"])))
    cpu_us = float(own["cpu_us"].sum()) - usual_us * float(own["cycles"].sum() - len(own))
    faults = int(own["page_faults"].sum() + own["pages_read"].sum())
    enough_us = 0.5 * excess_us
    for name, cause in (("collected_us", HostCause.COLLECTION), ("no_cpu_us", HostCause.NO_CPU)):
        if own[name].sum() >= enough_us:
            return cause, faults
    if cpu_us >= enough_us:
        if own["pages_read"].any():
            return HostCause.PAGES, faults
        parts = {
            HostCause.TICK: cycle["answered_us"] - cycle["read_us"],
            HostCause.SOCKET: cycle["read_us"] - cycle["seen_us"],
            HostCause.LAST_CYCLE: max(cycle["free_us"], 0.0),
        }
        return max(parts, key=lambda cause: float(parts[cause])), faults
    return HostCause.THREAD if own["others_us"].sum() >= enough_us else HostCause.STOPPED, faults
