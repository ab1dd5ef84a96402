"""Opens a cell by its address. The only module of rtstack that names the simulated robot."""

import sys
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

from hal.cell import Cell
from hal.displacement import Displacement
from hal.errors import HardwareError
from hal.fci import FciPair, Tool, open_pair
from hal.tracker_link import TrackerLink
from rtstack.cli.simulator import Simulator
from rtstack.live.source import CellSource, described_as
from rtstack.model.cell_description import CellDescription, TrackerAddress, load_cell_description
from rtstack.trials.errors import TrialError

KINDS = "direct, lockstep, realtime, fci:LEFT,RIGHT"


def default_cell_file() -> Path:
    """Return the path of the description of the simulated grabbing cell."""
    with as_file(files("deploy.cells") / "grab.toml") as path:
        return path


def load_description(path: Path | None) -> tuple[CellDescription, Path]:
    """Return the cell's description and the file that it came from. Raises ConfigurationError."""
    source = path or default_cell_file()
    return load_cell_description(source), source


def open_cell(
    kind: str, object_name: str, displacement: Displacement | float, seed: int,
    description: CellDescription | None = None, faults: Path | None = None, noise_seed: int | None = None,
    cell_file: Path | None = None,
) -> Cell:  # fmt: skip
    """Open a cell with the object, displaced from its place (a number: along y, m).

    Raises TrialError for an unknown kind, HardwareError from the cell.

    kind: direct (the plant in this process, deterministic); lockstep and realtime (a simulated robot in a process of
    its own, over the wire: it waits for answers, or keeps 1 kHz); fci:LEFT,RIGHT (robots at these addresses).
    object_name: empty for a cell without an object; at given addresses a person takes it away.
    faults: a script for a simulated robot, as for `rtstack sim --faults`. noise_seed: of placement and noise in the
    direct cell, where the same arms are to be met again. cell_file: where a simulated robot finds a lab's own objects.
    """
    description = description or load_description(None)[0]
    if kind == "direct":
        return _direct_cell(object_name, displacement, seed, faults, noise_seed, cell_file)
    if kind in ("lockstep", "realtime"):
        warning = plant_difference(cell_file, object_name)
        simulator = Simulator(
            object_name, Displacement.of(displacement), seed, lockstep=kind == "lockstep", faults=faults,
            cell_file=cell_file,
        )  # fmt: skip
        return replace(_simulator_cell(kind, simulator, _tool(description)), warning=warning)
    if faults is not None:
        raise TrialError(f"cell {kind!r}: only a simulated robot has scripted faults: rtstack sim --faults")
    return _fci_cell(kind, description)


def plant_difference(cell_file: Path | None, object_name: str) -> str:
    """Return in one line where the simulated object is not what the cell's file describes, "" where it is.

    Raises TrialError for a bad key of the plant's.
    """
    from sim_robot.lab_objects import difference, with_lab_objects
    from sim_robot.scene import load_scene
    from sim_robot.strict_toml import BadParameterFile

    if cell_file is None:
        return ""
    try:
        return difference(with_lab_objects(load_scene(), cell_file), cell_file, object_name) or ""
    except BadParameterFile as error:
        raise TrialError(str(error)) from None


def _direct_cell(
    object_name: str, displacement: Displacement | float, seed: int, faults: Path | None, noise_seed: int | None,
    cell_file: Path | None,
) -> Cell:  # fmt: skip
    from sim_robot.cell import simulated_cell
    from sim_robot.faults.file import load_faults
    from sim_robot.scene import NO_OBJECT
    from sim_robot.strict_toml import BadParameterFile

    try:
        script = () if faults is None else load_faults(faults)
        noise = seed if noise_seed is None else noise_seed
        cell = simulated_cell(
            object_name or NO_OBJECT, displacement, noise, faults=script, arms_seed=seed, cell_file=cell_file
        )
        return replace(cell.as_cell("direct"), warning=plant_difference(cell_file, object_name))
    except BadParameterFile as error:
        raise TrialError(str(error)) from None


def fci_addresses(kind: str) -> tuple[str, str]:
    """Return LEFT and RIGHT of fci:LEFT,RIGHT. Raises TrialError."""
    scheme, _, addresses = kind.partition(":")
    left, _, right = addresses.partition(",")
    if scheme != "fci" or not left or not right or "," in right:
        raise TrialError(f"unknown cell {kind!r}: choose one of {KINDS}")
    if left == right:
        raise TrialError(f"cell {kind!r}: two arms have two addresses")
    return left, right


def _tool(description: CellDescription) -> Tool:
    pad = description.pad
    return Tool.pad(pad.size, pad.mass, pad.flange_to_face)


def _fci_cell(kind: str, description: CellDescription) -> Cell:
    left, right = fci_addresses(kind)
    tracker = _listen(description.tracker)
    try:
        pair = open_pair(left, right, _tool(description))
    except BaseException:
        tracker.close()
        raise
    return Cell(kind, pair.left, pair.right, tracker, _TrackedLink(pair, tracker), own_clocks=True)


def _listen(tracker: TrackerAddress) -> TrackerLink:
    """Listen for the object's poses. Raises HardwareError with one line."""
    try:
        return TrackerLink(*tracker.listener)
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise HardwareError(
            f"cannot listen for the object's poses at {tracker.address}: {reason}; end whoever listens there, or give "
            "the cell's file another address under [tracker]"
        ) from None


class _TrackedLink:
    """Both arms at their addresses, and the tracker that is listened to."""

    def __init__(self, pair: FciPair, tracker: TrackerLink) -> None:
        self._pair = pair
        self._tracker = tracker
        self.start, self.wait, self.move = pair.start, pair.wait, pair.move

    def close(self) -> None:
        """Disconnect, and stop listening."""
        self._pair.close()
        self._tracker.close()


class _SimulatorLink:
    """Both arms of a simulator of our own: it ends with them."""

    def __init__(self, pair: FciPair, simulator: Simulator) -> None:
        self._pair = pair
        self._simulator = simulator
        self.start, self.wait, self.move = pair.start, pair.wait, pair.move

    def close(self) -> None:
        """Disconnect, end the simulator, and pass on what it says about its pace."""
        self._pair.close()
        self._simulator.close()
        if self._simulator.report:
            print(f"simulated robot: {self._simulator.report}", file=sys.stderr)


def _simulator_cell(kind: str, simulator: Simulator, tool: Tool) -> Cell:
    try:
        pair = open_pair(simulator.left, simulator.right, tool, shared_clock=kind == "lockstep")
    except BaseException:
        simulator.close()
        raise
    link = _SimulatorLink(pair, simulator)
    return Cell(kind, pair.left, pair.right, simulator.tracker, link, own_clocks=kind == "realtime")


def live_source(description: Path, kind: str = "direct") -> CellSource:
    """Return the cell that a person watches, for the robot process. Raises ConfigurationError, TrialError.

    direct: the plant in that process, paced: real time where the machine can, slower where it cannot, and never wrong.
    fci:LEFT,RIGHT: the arms at these addresses; the object lies where a person has put it.
    """
    described = described_as(load_cell_description(description), kind)
    if kind != "direct":
        fci_addresses(kind)

        def open_fci(object_name: str, displacement: Displacement, seed: int) -> Cell:
            return _fci_cell(kind, described)

        return CellSource(kind=kind, description=described, file=description, open_cell=open_fci)

    for name in described.objects:
        plant_difference(description, name)  # a bad key of the plant's is found before anything is opened

    def open_live(object_name: str, displacement: Displacement, seed: int) -> Cell:
        from sim_robot.cell import simulated_cell
        from sim_robot.clock import PacedLockstep
        from sim_robot.scene import NO_OBJECT

        cell = simulated_cell(
            object_name or NO_OBJECT, displacement, seed, clock=PacedLockstep(), cell_file=description
        )
        return replace(cell.as_cell("direct"), warning=plant_difference(description, object_name))

    return CellSource(kind=kind, description=described, file=description, open_cell=open_live)
