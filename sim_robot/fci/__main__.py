"""`python -m sim_robot.fci`: serve the simulated cell."""

import argparse
import signal
import sys

from hal.errors import HardwareError
from hal.realtime import ANY_CPU, Obtained, realtime_thread
from sim_robot.cell import simulated_cell
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.lockstep import Lockstep
from sim_robot.fci.realtime import Realtime, RightClock
from sim_robot.fci.server import Server
from sim_robot.fci.tracker_feed import TrackerFeed
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene


def _described(obtained: Obtained) -> str:
    scheduler = f"SCHED_FIFO {obtained.priority}" if obtained.scheduler == "fifo" else "ordinary scheduling"
    cpu = f", CPU {obtained.cpu}" if obtained.cpu != ANY_CPU else ""
    return f"1 kHz, {scheduler}{cpu}" + ("" if obtained.memory_locked else ", memory not locked")


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
    parser.add_argument("--cpu", type=int, default=ANY_CPU, help="CPU to stay on, -1 for any")
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
    where = f"serving {options.left} and {options.right}"
    if options.lockstep:
        print(f"{where}, lockstep", flush=True)
        Lockstep(server).run(lambda: bool(stop))
    else:
        pace = Realtime(server, right_clock)
        with realtime_thread(options.priority, options.cpu) as obtained:
            print(f"{where}, {_described(obtained)}", flush=True)
            pace.run(lambda: bool(stop))
        print(pace.report(), flush=True)
    server.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
