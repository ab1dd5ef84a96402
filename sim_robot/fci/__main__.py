"""`python -m sim_robot.fci`: serve the simulated cell."""

import argparse
import contextlib
import gc
import os
import signal
import sys

from hal.errors import HardwareError
from sim_robot.cell import simulated_cell
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.lockstep import Lockstep
from sim_robot.fci.realtime import Realtime, RightClock
from sim_robot.fci.server import Server
from sim_robot.fci.tracker_feed import TrackerFeed
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene


def _schedule(priority: int, cpu: int) -> str:
    """Take real-time scheduling and a CPU as far as the host allows; return what was obtained."""
    obtained = "1 kHz, ordinary scheduling"
    if priority > 0:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            obtained = f"1 kHz, SCHED_FIFO {priority}"
    if cpu >= 0:
        try:
            os.sched_setaffinity(0, {cpu})
            obtained += f", CPU {cpu}"
        except OSError:
            obtained += f", not on CPU {cpu}"
    gc.collect()
    gc.freeze()
    gc.disable()
    return obtained


def _listener(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGINT or SIGTERM. Returns 0, or 2 for bad input."""
    parser = argparse.ArgumentParser(prog="sim_robot.fci", description="The simulated cell behind the FCI.")
    parser.add_argument("--left", default="127.0.0.11", help="address of the left arm")
    parser.add_argument("--right", default="127.0.0.12", help="address of the right arm")
    parser.add_argument("--object", default="rice_box")
    parser.add_argument("--displacement-mm", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lockstep", action="store_true", help="wait for every moving arm's answer")
    parser.add_argument("--phase-us", type=float, default=0.0, help="how much later the right arm's clock ticks")
    parser.add_argument("--drift-ppm", type=float, default=0.0, help="how much faster the right arm's clock is")
    parser.add_argument("--priority", type=int, default=80, help="SCHED_FIFO priority, 0 for none")
    parser.add_argument("--cpu", type=int, default=-1, help="CPU to stay on, -1 for any")
    parser.add_argument("--tracker", type=_listener, help="HOST:PORT that listens for the object's poses (UDP)")
    options = parser.parse_args(arguments)
    try:
        right_clock = RightClock(options.phase_us, options.drift_ppm)
    except ValueError as error:
        parser.error(str(error))
    if options.lockstep and right_clock != RightClock():
        parser.error("in lockstep there is no clock that could differ: leave --lockstep, or --phase-us and --drift-ppm")
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, frame: stop.append(received))
    try:
        cell = simulated_cell(options.object, 1e-3 * options.displacement_mm, options.seed, box_kind=DrivenBox)
        server = Server(cell, load_scene(), load_plant_parameters(), (options.left, options.right))
        if options.tracker is not None:
            server.feed_tracker(TrackerFeed(cell.tracker, options.tracker))
    except (HardwareError, OSError) as error:
        print(f"cannot serve: {error}", file=sys.stderr)
        return 2
    how = "lockstep" if options.lockstep else _schedule(options.priority, options.cpu)
    print(f"serving {options.left} and {options.right}, {how}", flush=True)
    pace = Lockstep(server) if options.lockstep else Realtime(server, right_clock)
    pace.run(lambda: bool(stop))
    if isinstance(pace, Realtime):
        print(pace.report(), flush=True)
    server.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
