"""A client of two arms in one thread that answers each when its own state arrives (epoll on libfranka's sockets).

`python -m tests.programs.answer_times --seconds 20` serves two clocks and prints the time from a state to its answer.
"""

import argparse
import os
import select
import socket
import stat
import time
from dataclasses import dataclass

import numpy as np
import pylibfranka as franka

from tests.support.fci.client import connect, hold
from tests.support.fci.server import Served, serve

STATE_TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True)
class Record:
    """Per arm (left, right), each (ticks,): ids, success rates, when the state came, ns until it was answered.

    Besides, (ticks, 7) each: the torque that the state showed as desired, and the one that answered it.
    """

    message_ids: tuple[np.ndarray, np.ndarray]
    success_rates: tuple[np.ndarray, np.ndarray]
    came_ns: tuple[np.ndarray, np.ndarray]
    answer_ns: tuple[np.ndarray, np.ndarray]
    shown: tuple[np.ndarray, np.ndarray]
    answered: tuple[np.ndarray, np.ndarray]


def _sockets() -> set[int]:
    found = set()
    for name in os.listdir("/proc/self/fd"):
        try:
            if stat.S_ISSOCK(os.stat(int(name)).st_mode):
                found.add(int(name))
        except OSError:  # the descriptor of the listing itself
            continue
    return found


def _datagram_descriptor(candidates: set[int]) -> int:
    for number in candidates:
        copy = socket.socket(fileno=os.dup(number))
        with copy:
            if copy.type == socket.SOCK_DGRAM:
                return number
    raise RuntimeError("the client opened no datagram socket")


def hold_both(served: Served, ticks: int) -> Record:
    """Hold both arms for `ticks` of each. Raises what pylibfranka raises."""
    robots, descriptors = [], []
    for address in (served.left, served.right):
        before = _sockets()
        robots.append(connect(address))
        descriptors.append(_datagram_descriptor(_sockets() - before))
    q_hold = [np.array(robot.read_once().q) for robot in robots]
    ids: tuple[list, list] = ([], [])
    rates: tuple[list, list] = ([], [])
    came: tuple[list, list] = ([], [])
    answers: tuple[list, list] = ([], [])
    shown: tuple[list, list] = ([], [])
    answered: tuple[list, list] = ([], [])
    controls = [robot.start_torque_control() for robot in robots]
    with select.epoll() as epoll:
        for descriptor in descriptors:
            epoll.register(descriptor, select.EPOLLIN)
        open_sides = {0, 1}
        while open_sides:
            events = epoll.poll(STATE_TIMEOUT_S)
            if not events:
                raise TimeoutError("no state of either arm")
            for descriptor, _ in events:
                side, ready_ns = descriptors.index(descriptor), time.perf_counter_ns()
                state, _ = controls[side].readOnce()
                torque = hold(state, q_hold[side])
                command = franka.Torques(list(torque))
                command.motion_finished = len(ids[side]) == ticks - 1
                controls[side].writeOnce(command)
                came[side].append(ready_ns)
                answers[side].append(time.perf_counter_ns() - ready_ns)
                ids[side].append(round(1e3 * state.time.to_sec()))
                rates[side].append(state.control_command_success_rate)
                shown[side].append(state.tau_J_d)
                answered[side].append(torque)
                if len(ids[side]) == ticks:
                    epoll.unregister(descriptor)
                    open_sides.remove(side)
    arrays = [(np.array(both[0]), np.array(both[1])) for both in (ids, rates, came, answers, shown, answered)]
    return Record(*arrays)


def main() -> None:
    """Print the distribution per arm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--phase-us", type=float, default=500.0)
    parser.add_argument("--drift-ppm", type=float, default=50.0)
    options = parser.parse_args()
    with serve("--phase-us", str(options.phase_us), "--drift-ppm", str(options.drift_ppm)) as served:
        record = hold_both(served, round(1e3 * options.seconds))
    print("arm    ticks   skipped  rate min   state to answer us: p50    p99  p99.9    max")
    for side, name in enumerate(("left", "right")):
        us = 1e-3 * record.answer_ns[side]
        skipped = int(np.sum(np.diff(record.message_ids[side]) - 1))
        p50, p99, p999 = np.percentile(us, (50.0, 99.0, 99.9))
        rate = record.success_rates[side].min()
        print(f"{name:5} {us.size:6d} {skipped:9d} {rate:9.2f} {p50:27.0f} {p99:6.0f} {p999:6.0f} {us.max():6.0f}")


if __name__ == "__main__":
    main()
