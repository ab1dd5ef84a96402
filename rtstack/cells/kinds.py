"""Kinds of cells, by the entry points of the group rtstack.cells: `NAME` or `NAME:ARGUMENT` on the command line."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any

from hal.cell import Cell
from hal.displacement import Displacement
from hal.extensions import ExtensionError, ExtensionPoint, blaming, require
from rtstack.cells.description import load_description
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError


@dataclass(frozen=True, slots=True)
class CellRequest:
    """What a cell is opened with.

    kind: as it was asked for; argument: what stands behind the colon, "" for nothing. object_name: ""
    for a cell without an object, which a person takes away from real arms. displacement: of the object from its place.
    description: of the cell, from cell_file (None: ours). faults: a script for a simulated robot, as for `rtstack sim
    --faults`. noise_seed: of placement and noise, where the same simulated arms are to be met again (None: the seed).
    live: a person watches; a simulated robot keeps the pace of the host's clock where it can. led: a person leads the
    arms, or one joint turns by a degree: the cell's geometry need not have been measured.
    """

    kind: str
    argument: str
    object_name: str
    displacement: Displacement
    seed: int
    description: CellDescription
    cell_file: Path | None = None
    faults: Path | None = None
    noise_seed: int | None = None
    live: bool = False
    led: bool = False


@dataclass(frozen=True, slots=True)
class CellKind:
    """What a package offers: how a cell of a kind is opened.

    open: the caller closes the cell; raises HardwareError or TrialError with one line. check (argument, description,
    its file): raises TrialError for what `rtstack up` is to refuse before it starts; measured: the same for a geometry
    that was not measured, which a person who leads the arms does not need. simulated (argument, description): whether
    all arms are simulated ones; it decides what an operator is told.
    """

    open: Callable[[CellRequest], Cell]
    check: Callable[[str, CellDescription, Path | None], None] = lambda argument, description, file: None
    simulated: Callable[[str, CellDescription], bool] = lambda argument, description: False
    measured: Callable[[str, CellDescription, Path | None], None] = lambda argument, description, file: None


SIMULATED = ("direct", "lockstep", "realtime")  # ours; behind the colon stands the profile of the simulated robot
IDEAL = "ideal"
CELLS = ExtensionPoint("rtstack.cells", "cell", CellKind)


def kind_of(kind: str) -> tuple[CellKind, str]:
    """Return the kind of cell of `NAME` or `NAME:ARGUMENT`, and the argument. Raises TrialError."""
    name, _, argument = kind.partition(":")
    try:
        found = CELLS.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None
    return CellKind(*(_guarded(name, each.name, getattr(found, each.name)) for each in fields(CellKind))), argument


def _guarded(name: str, what: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of a kind of cell as one that raises TrialError where another author's code raises."""

    @wraps(function)
    def call(*arguments: Any) -> Any:
        with blaming(f"the cell {name} cannot be used: {what}", function, error=TrialError):
            made = function(*arguments)
            if what == "open" and not isinstance(made, Cell):
                raise TypeError(f"it returned a {type(made).__name__}, not a hal.cell.Cell")
            if what == "open":
                require(made.tracker, "latest")
                for sensor in made.sensors:
                    require(sensor, "read")
            return made

    return call


def with_profile(kind: str, profile: str | None) -> str:
    """Return a simulated cell's kind with its profile behind the colon; the kind itself for None and for ideal.

    Raises TrialError for a kind that takes none.
    """
    if profile is None:
        return kind
    if kind not in SIMULATED:
        raise TrialError(
            f"--profile is for the cells {', '.join(SIMULATED)}, not for {kind!r}: "
            "for arms at addresses give it to `rtstack sim`"
        )
    return kind if profile == IDEAL else f"{kind}:{profile}"


def profile_of(kind: str) -> str:
    """Return the profile of a simulated cell of ours, "" for any other cell, whose profile is not known here."""
    name, _, profile = kind.partition(":")
    return (profile or IDEAL) if name in SIMULATED else ""


def open_cell(
    kind: str, object_name: str, displacement: Displacement | float, seed: int,
    description: CellDescription | None = None, faults: Path | None = None, noise_seed: int | None = None,
    cell_file: Path | None = None, live: bool = False, led: bool = False,
) -> Cell:  # fmt: skip
    """Open a cell; see CellRequest. displacement: a number is one along y, m. Raises TrialError, HardwareError.

    Ours: direct (the plant in this process, deterministic); lockstep and realtime (a simulated robot in a process of
    its own, over the wire: it waits for answers, or keeps 1 kHz), each also as direct:PROFILE; fci:LEFT,RIGHT (robots
    at these addresses).
    """
    found, argument = kind_of(kind)
    described = description or load_description(None)[0]
    request = CellRequest(
        kind, argument, object_name, Displacement.of(displacement), seed, described, cell_file, faults, noise_seed,
        live, led,
    )  # fmt: skip
    return found.open(request)
