"""What it costs a cycle to know who was late: the look at the socket, the stamps, the host's counters.

    python -m tests.programs.cycle_cost [--cycles 20000]

A datagram as long as a state comes over the loopback device and is looked at as the loop does, then read by somebody
else: percentiles in us of each part, without what the clock takes, and the mean of all but the slowest hundredth.
"""

import argparse
import socket
import time

import numpy as np

from hal.fci.cycle_times import CycleTimes, stamp_arrivals
from hal.fci.datagram import BYTES
from hal.host_work import HostWork

PARTS = ("look at the socket", "stamp of reading", "stamp of the answer", "host's counters")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=20_000)
    count = parser.parse_args().cycles
    now = time.perf_counter_ns
    marks = np.zeros((count, len(PARTS) + 1), np.int64)
    cycles = CycleTimes()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours,
        HostWork() as work,
    ):
        ours.bind(("127.0.0.1", 0))
        robot.connect(ours.getsockname())
        stamp_arrivals(ours.fileno())
        for k in range(count):
            robot.send((k + 1).to_bytes(8, "little") + bytes(BYTES - 8))
            row = marks[k]
            row[0] = now()
            cycles.look(ours.fileno())
            row[1] = now()
            cycles.read()
            row[2] = now()
            cycles.answer((k + 1) * 1_000_000)
            row[3] = now()
            work.cycle(cycles.late)
            row[4] = now()
            ours.recv(BYTES)
    empty = [now() for _ in range(count)]
    cost_us = 1e-3 * (np.diff(marks, axis=1) - np.median(np.diff(empty)))
    for part, each in zip((*PARTS, "all"), (*cost_us.T, cost_us.sum(axis=1)), strict=True):
        low, middle, high = np.percentile(each, (10, 50, 90))
        usual = float(each[each <= np.percentile(each, 99)].mean())
        print(f"{part:<20} p10 {low:5.2f}  p50 {middle:5.2f}  p90 {high:5.2f}  mean {usual:5.2f} us")


if __name__ == "__main__":
    main()
