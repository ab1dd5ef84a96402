"""Starts, stops, errors and recoveries of two arms whose boxes are slow: does one arm ever starve for the other one?

python -m tests.programs.slow_boxes [--profile harsh] [--times 200] [--slower 1] [--unheld] [--recoveries 20]

Each time torque control begins and ends, the left arm first or the right one in turn; once in a while one arm is sent a
torque that jumps, and both are recovered. --unheld: as it was before the other arm was held meanwhile.

Beside it a process a CPU, of a higher priority than the client's, sleeps for 1 ms again and again: where it wakes late
by more than a period, the host took the CPU away. A packet that is lost within three periods of that is the host's.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np

from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected
from hal.fci import FciPair, open_pair
from hal.joint_path import JointSpeed
from hal.realtime import PRIORITY, realtime_thread
from tests.support.fci.server import serve

TICKS = 40
LATE_PERIODS = 3  # from a stall to the state that tells of the lost packet
PROBE = """
import json, os, select, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
last, stalls = time.monotonic(), []
while not select.select([0], [], [], 0.001)[0]:
    now = time.monotonic()
    stalls += [(last, now)] if now - last > float(sys.argv[3]) else []
    last = now
print(json.dumps(stalls))
"""


class Probe:
    """When the host took a CPU away for longer than over_s."""

    def __init__(self, over_s: float) -> None:
        words = [sys.executable, "-c", PROBE]
        self._processes = [
            subprocess.Popen([*words, str(cpu), str(PRIORITY + 1), str(over_s)], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True)
            for cpu in os.sched_getaffinity(0)
        ]  # fmt: skip

    def stalls(self) -> list[tuple[float, float]]:
        """End it; return from when to when, s of time.monotonic()."""
        return [tuple(each) for process in self._processes for each in json.loads(process.communicate("")[0])]


@dataclass
class Figures:
    """errors: of the arm that should have stayed well, by name; lost: when a packet was, by an arm's success rate."""

    times: int = 0
    errors: Counter = field(default_factory=Counter)
    lost: list[float] = field(default_factory=list)
    stalls: list[tuple[float, float]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    recoveries: int = 0
    longest_s: dict[str, float] = field(default_factory=dict)

    def timed(self, what: str, began_s: float) -> None:
        self.longest_s[what] = max(self.longest_s.get(what, 0.0), time.monotonic() - began_s)


def _control(pair: FciPair, figures: Figures) -> None:
    """Start both and hold them for some ticks."""
    began = time.monotonic()
    pair.start()
    figures.timed("start", began)
    arms, ticks, rates = (pair.left, pair.right), [0, 0], [1.0, 1.0]
    while min(ticks) < TICKS:
        mask = pair.wait()
        for k in (0, 1):
            if mask & (LEFT, RIGHT)[k]:
                rate = float(arms[k].read().record["control_command_success_rate"][0])
                figures.lost += [time.monotonic()] * round(100.0 * max(0.0, rates[k] - rate))
                rates[k], ticks[k] = rate, ticks[k] + 1
                arms[k].write(np.zeros(7))


def _recover(pair: FciPair, figures: Figures) -> None:
    began = time.monotonic()
    pair.recover()
    figures.timed("recovery", began)
    figures.recoveries += 1


def _break(pair: FciPair, side: int, figures: Figures) -> None:
    """Send one arm a torque that jumps; the other one has to be well afterwards."""
    arm, other = (pair.left, pair.right) if side == 0 else (pair.right, pair.left)
    arm.read()
    try:
        arm.write(np.full(7, 40.0))
        while True:
            arm.read()
    except CommandRejected:
        pass
    pair.stop()
    figures.errors.update(f"beside a reflex: {name}" for name in other.reflex())
    _recover(pair, figures)


def measure(profile: str, times: int, slower: float, recoveries: int, held: bool) -> Figures:
    """Return what came of it."""
    figures, probe = Figures(), Probe(1e-3 + 1e-3 * slower)  # it sleeps for 1 ms
    every = max(1, times // recoveries) if recoveries else 0
    clocks = "--phase-us", "400", "--drift-ppm", "50"
    with serve("--profile", profile, "--slower", str(slower), *clocks) as served, realtime_thread():
        pair = open_pair(served.left, served.right)
        if not held:
            pair.holding = lambda arm: nullcontext()  # type: ignore[method-assign]
        home = np.stack([arm.read().q.copy() for arm in (pair.left, pair.right)])
        try:
            for number in range(times):
                figures.times += 1
                try:
                    _control(pair, figures)
                    if every and number % every == every - 1:
                        _break(pair, number // every % 2, figures)
                        continue
                    began = time.monotonic()
                    pair.stop((LEFT, RIGHT)[number % 2], at_rest=True)
                    figures.timed("stop", began)
                    if number % 20 == 10:
                        began = time.monotonic()
                        pair.move(home, JointSpeed(0.4, 1.0), lambda: False)
                        figures.timed("start motion", began)
                except CommandRejected as error:
                    print(f"{number}: {error}", flush=True)
                    figures.errors.update(error.errors or (str(error),))
                    pair.stop()
                    _recover(pair, figures)
                    continue
                if names := (*pair.left.reflex(), *pair.right.reflex()):
                    print(f"{number}: after the stop: {names}", flush=True)
                    figures.errors.update(names)
                    _recover(pair, figures)
        finally:
            pair.close()
    figures.said, figures.stalls = served.said, probe.stalls()
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--profile", default="harsh")
    parser.add_argument("--times", type=int, default=200)
    parser.add_argument("--slower", type=float, default=1.0)
    parser.add_argument("--recoveries", type=int, default=20)
    parser.add_argument("--unheld", action="store_true")
    options = parser.parse_args()
    figures = measure(options.profile, options.times, options.slower, options.recoveries, not options.unheld)
    longest = ", ".join(f"{what} {1e3 * seconds:.0f} ms" for what, seconds in figures.longest_s.items())
    print(f"{options.profile}, {options.slower:g} times slower than real time: {figures.times} starts and stops,")
    print(f"{figures.recoveries} recoveries; longest: {longest}")
    late_s = LATE_PERIODS * 1e-3 * options.slower
    hosts = sum(any(began <= at <= ended + late_s for began, ended in figures.stalls) for at in figures.lost)
    print(f"errors that should not be: {dict(figures.errors) or 'none'}; packets lost: {len(figures.lost)}, of which")
    print(f"{hosts} within {LATE_PERIODS} periods of one of {len(figures.stalls)} stalls of this host")
    print("\n".join(figures.said))
    return int(bool(figures.errors))


if __name__ == "__main__":
    sys.exit(main())
