"""The program behind `rtstack sim`: serve the simulated cell."""

import contextlib
import errno
import os
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

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
from sim_robot.profile import IDEAL


@dataclass(frozen=True)
class Options:
    """What `rtstack sim` serves. Raises ConfigurationError for values that make no sense, alone or together."""

    scene: str = "grab"  # the name of a file in sim_robot/scenes, or a scene's TOML
    left: str = "127.0.0.11"
    right: str = "127.0.0.12"
    only: str | None = None  # the one arm that is served
    lockstep: bool = False  # wait for every moving arm's answer
    seed: int = 0
    object_name: str = ""  # by default the scene's first; none for an empty cell
    displacement_mm: float = 0.0
    displacement_x_mm: float = 0.0
    yaw_deg: float = 0.0
    cell_file: Path | None = None
    faults: Path | None = None  # a script of them (sim_robot/faults/kinds.py)
    profile: str = IDEAL
    tracker: str = ""  # HOST:PORT that is sent the object's poses; empty for none
    phase_us: float = 0.0
    drift_ppm: float = 0.0
    desk: bool = False
    priority: int = 80
    cpu: int = ANY_CPU
    parameters: Path | None = None  # the plant's, a TOML as parameters/plant.toml
    arms_seed: int | None = None  # by default the seed
    slower: float = 1.0
    self_test_due_s: float = SELF_TEST_EVERY_S

    def __post_init__(self) -> None:
        if self.tracker and self.listener is None:
            raise ConfigurationError(f"--tracker: expected HOST:PORT, as in 127.0.0.1:1341, got {self.tracker!r}")
        if self.right_clock != RightClock() and self.lockstep:
            raise ConfigurationError(
                "in lockstep there is no clock that could differ: leave --lockstep, or --phase-us and --drift-ppm"
            )

    @property
    def listener(self) -> tuple[str, int] | None:
        """Where the object's poses are sent, None for nowhere."""
        host, _, port = self.tracker.rpartition(":")
        return (host, int(port)) if host and port.isdecimal() and 0 < int(port[:6]) < 1 << 16 else None

    @property
    def right_clock(self) -> RightClock:
        """How the right arm's clock differs. Raises ConfigurationError."""
        try:
            return RightClock(self.phase_us, self.drift_ppm)
        except ValueError as error:
            raise ConfigurationError(str(error)) from None


def _described(obtained: Obtained) -> str:
    scheduler = f"SCHED_FIFO {obtained.priority}" if obtained.scheduler == "fifo" else "ordinary scheduling"
    cpu = f", CPU {obtained.cpu}" if obtained.cpu != ANY_CPU else ""
    return f"1 kHz, {scheduler}{cpu}" + ("" if obtained.memory_locked else ", memory not locked")


def _scene_file(name: str) -> Path:
    """Return the file of a scene by its name, or of a path that ends in .toml. Raises ConfigurationError."""
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


def _addresses(options: Options) -> dict[str, str]:
    """Return the arms' addresses by name. Raises ConfigurationError."""
    only = None if options.only is None else (options.only,)
    sides = cell_scene(_scene_file(options.scene), options.cell_file, only).sides
    if len(sides) == 1 and options.right_clock != RightClock():
        raise ConfigurationError(f"--phase-us and --drift-ppm compare two arms, and the {sides[0]} one is served alone")
    if len(sides) > 1 and options.left == options.right:
        raise ConfigurationError(f"two arms have two addresses, --left and --right are both {options.left}")
    return {side: getattr(options, side) for side in sides}


def _open(options: Options, addresses: dict[str, str]) -> Server:
    """Build the cell and listen. Raises HardwareError, ConfigurationError, OSError."""
    sides = tuple(addresses)
    faults = load_faults(options.faults, sides) if options.faults is not None else ()
    displacement = Displacement.given(options.displacement_mm, options.displacement_x_mm, options.yaw_deg)
    scene, parameters = _scene_file(options.scene), load_plant_parameters(options.parameters)
    name = options.object_name or next(iter(cell_scene(scene, options.cell_file).objects))
    cell = simulated_cell(
        name, displacement, options.seed,
        scene=scene, cell_file=options.cell_file, parameters=parameters, box_kind=DrivenBox, faults=faults,
        on_the_wire=True, profile=options.profile, sides=sides, arms_seed=options.arms_seed,
    )  # fmt: skip
    if options.cell_file is not None and (other := difference(cell.scene, options.cell_file, name)):
        print(f"warning: {other}", file=sys.stderr, flush=True)
    server = Server(cell, parameters, tuple(addresses.values()))
    if options.listener is not None:
        try:
            server.feed_tracker(TrackerFeed(cell.plant.profile.built.tracker(cell.tracker), options.listener))
        except OSError as error:
            server.close()
            raise ConfigurationError(f"--tracker {options.tracker} cannot be sent to: {error.strerror}") from None
    return server


def _at_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def end_at_signals() -> None:
    """Let SIGINT and SIGTERM end this process at once: nothing runs yet, and imports and compiling take a while."""
    _at_signals(lambda number, frame: os._exit(0))


def serve(options: Options, next_step: Callable[[dict[str, str]], str] = lambda addresses: "") -> int:
    """Serve until SIGINT or SIGTERM; return 0, 2 for bad input, 1 when it cannot go on. next_step: a line to print."""
    end_at_signals()
    addresses: dict[str, str] = {}
    try:
        addresses = _addresses(options)
        server = _open(options, addresses)
    except (HardwareError, ConfigurationError, OSError) as error:
        reason = _explained(error, tuple(addresses)) if isinstance(error, OSError) else str(error)
        print(f"cannot serve: {' '.join(reason.split())}", file=sys.stderr)
        return 2
    try:
        with _desk(options, addresses, server) as said:
            _run(server, options, addresses, said + next_step(addresses))
    except HardwareError as error:
        print(f"cannot go on: {error}", file=sys.stderr)
        return 1
    finally:
        server.close()
    return 0


@contextlib.contextmanager
def _desk(options: Options, addresses: dict[str, str], server: Server) -> Iterator[str]:
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


def _run(server: Server, options: Options, addresses: dict[str, str], next_step: str) -> None:
    received: list[int] = []
    _at_signals(lambda number, frame: received.append(number))
    said = f", profile {options.profile}" + ("\n" + next_step if next_step else "")
    where = f"serving {' and '.join(addresses.values())}"
    if options.lockstep:
        print(f"{where}, lockstep{said}", flush=True)
        Lockstep(server).run(lambda: bool(received))
        return
    pace = Realtime(server, options.right_clock, options.slower)
    with realtime_thread(options.priority, options.cpu) as obtained:
        print(f"{where}, {_described(obtained)}{said}", flush=True)
        pace.run(lambda: bool(received))
    print(pace.report(), flush=True)
