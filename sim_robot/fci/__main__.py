"""`python -m sim_robot.fci`: serve the simulated cell."""

import argparse
import contextlib
import errno
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

from hal.base.configuration import ConfigurationError
from hal.base.realtime import ANY_CPU, Obtained, realtime_thread
from hal.displacement import Displacement
from hal.errors import HardwareError
from sim_robot.cell import cell_scene, simulated_cell
from sim_robot.desk.box import SELF_TEST_EVERY_S
from sim_robot.desk.process import PORT, DeskProcess
from sim_robot.desk.server import PASSWORD, USER
from sim_robot.faults.file import load_faults
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.lockstep import Lockstep
from sim_robot.fci.realtime import Realtime, RightClock
from sim_robot.fci.server import Server, TrackerFeed
from sim_robot.lab_objects import difference
from sim_robot.plant_parameters import OWN_FILES, load_plant_parameters
from sim_robot.profile import IDEAL, profile_names
from sim_robot.scene import SIDES

LARGEST_PRIORITY = 99  # sched(7)


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see --help)\n")


def _described(obtained: Obtained) -> str:
    scheduler = f"SCHED_FIFO {obtained.priority}" if obtained.scheduler == "fifo" else "ordinary scheduling"
    cpu = f", CPU {obtained.cpu}" if obtained.cpu != ANY_CPU else ""
    return f"1 kHz, {scheduler}{cpu}" + ("" if obtained.memory_locked else ", memory not locked")


def _listener(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port[:6]) < 1 << 16:
        raise argparse.ArgumentTypeError(f"expected HOST:PORT, as in 127.0.0.1:1341, got {text!r}")
    return host, int(port)


def _factor(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"expected a number from 1 to 100, got {text}")
    return value


def _whole(lowest: int, largest: float = float("inf")):
    def number(text: str) -> int:
        value = int(text)
        if not lowest <= value <= largest:
            raise ValueError
        return value

    number.__name__ = f"whole number from {lowest}" + (f" to {largest}" if largest < float("inf") else "")
    return number


def _scene_file(name: str) -> Path:
    """Return where the scene of this name is; of a name that ends in .toml, the file itself. Raises ConfigurationError,
    naming those that exist."""
    if name.endswith(".toml"):
        return Path(name)
    scenes = {file.stem: file for file in sorted((OWN_FILES / "scenes").glob("*.toml"))}
    if name not in scenes:
        raise ConfigurationError(f"unknown scene {name!r}; there is {', '.join(scenes)}")
    return scenes[name]


def _explained(error: OSError, sides: tuple[str, ...]) -> str:
    options = " and ".join(f"--{side}" for side in sides)
    unknown_name = error.errno is not None and error.errno < 0  # getaddrinfo's codes, in a plain OSError
    if unknown_name or error.errno == errno.EADDRNOTAVAIL:
        return f"{error.strerror}; give {options} addresses of this host, such as 127.0.0.11"
    if error.errno == errno.EADDRINUSE:
        return f"{error.strerror}; end who serves there, or choose others with {options}"
    return str(error)


def _options(arguments: list[str] | None, prog: str) -> tuple[argparse.Namespace, RightClock]:
    parser = _Parser(prog=prog, description="The simulated cell behind the FCI.")
    parser.add_argument("--scene", default="grab", help="name of a file in sim_robot/scenes, or a scene's TOML")
    parser.add_argument("--parameters", type=Path, help="the plant's parameters, a TOML as parameters/plant.toml")
    parser.add_argument("--left", default="127.0.0.11", help="address of the left arm")
    parser.add_argument("--right", default="127.0.0.12", help="address of the right arm")
    parser.add_argument("--only", choices=SIDES, help="serve this arm alone; so does a cell's TOML with one arm")
    parser.add_argument("--object", default="", help="by default the scene's first one")
    parser.add_argument("--cell-file", type=Path, help="a cell's TOML, for the objects that it adds")
    parser.add_argument("--displacement-mm", type=float, default=0.0, help="shift of the object along y")
    parser.add_argument("--displacement-x-mm", type=float, default=0.0, help="shift of the object along x")
    parser.add_argument("--yaw-deg", type=float, default=0.0, help="turn of the object about z")
    parser.add_argument("--seed", type=_whole(0), default=0)
    parser.add_argument("--arms-seed", type=_whole(0), help="whose arms these are, by default the seed's")
    parser.add_argument("--profile", default=IDEAL, help=f"how honest it is: {', '.join(profile_names())}")
    parser.add_argument("--lockstep", action="store_true", help="wait for every moving arm's answer")
    parser.add_argument("--phase-us", type=float, default=0.0, help="how much later the right arm's clock ticks")
    parser.add_argument("--drift-ppm", type=float, default=0.0, help="how much faster the right arm's clock is")
    parser.add_argument("--slower", type=_factor, default=1.0, help="so many times slower than real time")
    parser.add_argument(
        "--priority", type=_whole(0, LARGEST_PRIORITY), default=80, help="SCHED_FIFO priority, 0 for none"
    )
    parser.add_argument("--cpu", type=_whole(ANY_CPU), default=ANY_CPU, help="CPU to stay on, -1 for any")
    parser.add_argument("--tracker", type=_listener, help="HOST:PORT that listens for the object's poses (UDP)")
    parser.add_argument("--desk", action="store_true", help="serve Desk too; the boxes begin locked, with FCI off")
    parser.add_argument("--self-test-due-s", type=float, default=SELF_TEST_EVERY_S, help="with --desk: in how long")
    parser.add_argument("--faults", type=Path, help="TOML script of what goes wrong (sim_robot/faults/kinds.py)")
    options = parser.parse_args(arguments)
    try:
        right_clock = RightClock(options.phase_us, options.drift_ppm)
    except ValueError as error:
        parser.error(str(error))
    if options.lockstep and right_clock != RightClock():
        parser.error("in lockstep there is no clock that could differ: leave --lockstep, or --phase-us and --drift-ppm")
    return options, right_clock


def _addresses(options: argparse.Namespace, right_clock: RightClock) -> dict[str, str]:
    """Return the address of each arm that is served, by the arm's name. Raises ConfigurationError."""
    only = None if options.only is None else (options.only,)
    sides = cell_scene(_scene_file(options.scene), options.cell_file, only).sides
    if len(sides) == 1 and right_clock != RightClock():
        raise ConfigurationError(f"--phase-us and --drift-ppm compare two arms, and the {sides[0]} one is served alone")
    if len(sides) > 1 and options.left == options.right:
        raise ConfigurationError(f"two arms have two addresses, --left and --right are both {options.left}")
    return {side: getattr(options, side) for side in sides}


def _open(options: argparse.Namespace, addresses: dict[str, str]) -> Server:
    """Build the cell and listen. Raises HardwareError, ConfigurationError, OSError."""
    sides = tuple(addresses)
    faults = load_faults(options.faults, sides) if options.faults is not None else ()
    displacement = Displacement.given(options.displacement_mm, options.displacement_x_mm, options.yaw_deg)
    scene, parameters = _scene_file(options.scene), load_plant_parameters(options.parameters)
    name = options.object or next(iter(cell_scene(scene, options.cell_file).objects))
    cell = simulated_cell(
        name, displacement, options.seed,
        scene=scene, cell_file=options.cell_file, parameters=parameters, box_kind=DrivenBox, faults=faults,
        on_the_wire=True, profile=options.profile, sides=sides, arms_seed=options.arms_seed,
    )  # fmt: skip
    if options.cell_file is not None and (other := difference(cell.scene, options.cell_file, name)):
        print(f"warning: {other}", file=sys.stderr, flush=True)
    server = Server(cell, parameters, tuple(addresses.values()))
    if options.tracker is not None:
        host, port = options.tracker
        try:
            server.feed_tracker(TrackerFeed(cell.plant.profile.built.tracker(cell.tracker), options.tracker))
        except OSError as error:
            server.close()
            raise ConfigurationError(f"--tracker {host}:{port} cannot be sent to: {error.strerror}") from None
    return server


def _at_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def main(
    arguments: list[str] | None = None,
    prog: str = "sim_robot.fci",
    next_step: Callable[[dict[str, str]], str] = lambda addresses: "",
) -> int:
    """Serve until SIGINT or SIGTERM. Returns 0; 2 for bad input; 1 when the simulation cannot go on.

    next_step: a line to print once it serves, for the arms' addresses by name (left, right).
    """
    _at_signals(lambda number, frame: os._exit(0))  # nothing to end yet, and compiling may take a while
    options, right_clock = _options(arguments, prog)
    addresses: dict[str, str] = {}
    try:
        addresses = _addresses(options, right_clock)
        server = _open(options, addresses)
    except (HardwareError, ConfigurationError, OSError) as error:
        reason = _explained(error, tuple(addresses)) if isinstance(error, OSError) else str(error)
        print(f"cannot serve: {' '.join(reason.split())}", file=sys.stderr)
        return 2
    try:
        with _desk(options, addresses, server) as said:
            _serve(server, options, addresses, right_clock, said + next_step(addresses))
    except HardwareError as error:
        print(f"cannot go on: {error}", file=sys.stderr)
        return 1
    finally:
        server.close()
    return 0


@contextlib.contextmanager
def _desk(options: argparse.Namespace, addresses: dict[str, str], server: Server) -> Iterator[str]:
    """Serve Desk beside the arms, where it is asked for; give the line that says where. Raises HardwareError."""
    if not options.desk:
        yield ""
        return
    process = DeskProcess(addresses, options.self_test_due_s)
    try:
        server.follow_desk(process.flags)
        where = " and ".join(f"https://{address}:{PORT}" for address in addresses.values())
        yield f"Desk: {where}, user {USER}, password {PASSWORD}\n"
    finally:
        process.close()


def _serve(
    server: Server, options: argparse.Namespace, addresses: dict[str, str], right_clock: RightClock, next_step: str
) -> None:
    received: list[int] = []
    _at_signals(lambda number, frame: received.append(number))
    said = f", profile {options.profile}" + ("\n" + next_step if next_step else "")
    where = f"serving {' and '.join(addresses.values())}"
    if options.lockstep:
        print(f"{where}, lockstep{said}", flush=True)
        Lockstep(server).run(lambda: bool(received))
        return
    pace = Realtime(server, right_clock, options.slower)
    with realtime_thread(options.priority, options.cpu) as obtained:
        print(f"{where}, {_described(obtained)}{said}", flush=True)
        pace.run(lambda: bool(received))
    print(pace.report(), flush=True)


if __name__ == "__main__":
    sys.exit(main())
