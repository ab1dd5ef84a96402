"""The simulated cell, in this process or behind the wire. Only this and the command line name the simulated robot."""

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from hal.base.configuration import ConfigurationError
from hal.base.extras import require
from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.tracker import TrackerFrames
from rtstack.cells.kinds import CellKind, CellRequest
from rtstack.cells.simulator import Simulator
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError


def plant_difference(cell_file: Path | None, object_name: str) -> str:
    """Return in one line where the simulated object is not what the cell's file describes, or "".

    Raises TrialError for a bad key of the plant's.
    """
    from sim_robot.lab_objects import difference, with_lab_objects
    from sim_robot.scene import load_scene

    if cell_file is None:
        return ""
    try:
        return difference(with_lab_objects(load_scene(), cell_file), cell_file, object_name) or ""
    except ConfigurationError as error:
        raise TrialError(str(error)) from None


def _check(argument: str, _description: CellDescription, cell_file: Path | None) -> None:
    require("sim")
    from sim_robot.scene import NO_OBJECT

    _profile(argument)
    plant_difference(cell_file, NO_OBJECT)  # a bad key of the plant's, of any object


def _check_served(argument: str, description: CellDescription, cell_file: Path | None) -> None:
    import_module("hal.fci")
    _check(argument, description, cell_file)


def _profile(argument: str) -> str:
    """Return the name of the profile that stands behind a simulated cell's name. Raises TrialError."""
    from sim_robot.profile import IDEAL, load_profile

    name = argument or IDEAL
    try:
        load_profile(name)
    except ConfigurationError as error:
        raise TrialError(f"a simulated cell has no address, behind its name stands its profile: {error}") from None
    return name


def _open_direct(request: CellRequest) -> Cell:
    from sim_robot.cell import simulated_cell
    from sim_robot.clock import PacedLockstep
    from sim_robot.faults.file import load_faults
    from sim_robot.scene import NO_OBJECT

    profile, sides = _profile(request.argument), request.description.sides
    try:
        script = () if request.faults is None else load_faults(request.faults, sides)
        noise = request.seed if request.noise_seed is None else request.noise_seed
        cell = simulated_cell(
            request.object_name or NO_OBJECT, request.displacement, noise, faults=script, arms_seed=request.seed,
            cell_file=request.cell_file, clock=PacedLockstep() if request.live else None, profile=profile,
            sides=sides,
        )  # fmt: skip
        return replace(cell.as_cell(request.kind), warning=plant_difference(request.cell_file, request.object_name))
    except ConfigurationError as error:
        raise TrialError(str(error)) from None


def _open_served(request: CellRequest) -> Cell:
    profile = _profile(request.argument)
    warning = plant_difference(request.cell_file, request.object_name)
    lockstep = request.kind.partition(":")[0] == "lockstep"
    simulator = Simulator(
        request.object_name, request.displacement, request.seed, lockstep=lockstep, faults=request.faults,
        cell_file=request.cell_file, profile=profile, frames=_tracker_frames(request),
        sides=request.description.sides,
    )  # fmt: skip
    return replace(served_cell(request.kind, simulator, request.description, lockstep), warning=warning)


def _tracker_frames(request: CellRequest) -> TrackerFrames:
    """Return the tracker's frames by the cell's file. Raises TrialError."""
    try:
        return request.description.tracker.frames(request.object_name)
    except ValueError as error:
        raise TrialError(f"the tracker of the cell's file: {error}") from None


def served_cell(kind: str, simulator: Simulator, description: CellDescription, lockstep: bool) -> Cell:
    """Return the cell of a running simulator, which ends with it. lockstep: it waits. Raises HardwareError."""
    try:
        # brings pylibfranka, which not every Python has, and which a plant in this process does without
        from hal.fci import open_pair
        from rtstack.cells.fci import ClosingLink, approach_collisions, pad_tools
        from rtstack.cells.robot_clock import RobotClock

        pair = open_pair(
            simulator.left, simulator.right, pad_tools(description), approach_collisions(description),
            shared_clock=lockstep,
        )  # fmt: skip
    except BaseException:
        simulator.close()
        raise
    clock = None if lockstep else RobotClock(pair, ClockRelation())

    def end_simulator() -> None:
        simulator.close()
        if simulator.report:
            print(f"simulated robot: {simulator.report}", file=sys.stderr)

    link = ClosingLink(pair, pair.wait if clock is None else clock.wait, end_simulator)
    return Cell(
        kind, pair.left, pair.right, simulator.tracker, link, own_clocks=not lockstep,
        sensors=() if clock is None else (clock,), cycles=pair.cycles,
    )  # fmt: skip


direct = CellKind(_open_direct, _check, lambda argument, description: True)
served = CellKind(_open_served, _check_served, lambda argument, description: True)
