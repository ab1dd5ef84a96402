"""Where the robot process gets its cell from: a factory that a composition root hands over by its name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Protocol

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.model.cell_description import CellDescription


class OpenCell(Protocol):
    """Open a cell with an object in it, displaced from its place; without a name: with none.

    Each call gives a fresh cell; the caller closes it. Raises hal.errors.HardwareError with one clear line.
    """

    def __call__(self, object_name: str, displacement: Displacement, seed: int) -> Cell: ...


@dataclass(frozen=True, slots=True)
class CellSource:
    """A kind of cell (as the command line spells it), its description and that file, and how to open one."""

    kind: str
    description: CellDescription
    file: Path
    open_cell: OpenCell


class SourceError(Exception):
    """The name of the factory leads nowhere; the message says where it broke off."""


def described_as(description: CellDescription, kind: str) -> CellDescription:
    """Return what a description says of a cell of this kind: whether its arms are simulated.

    Nobody may be told that a real arm is a simulated one: beside the plant of ours (direct), only arms on this machine
    can be.
    """
    addresses = kind.removeprefix("fci:").split(",")
    here = all(address.startswith("127.") for address in addresses)
    return replace(description, simulated=kind == "direct" or (description.simulated and here))


def load_source(name: str, description: Path, kind: str) -> CellSource:
    """Call the factory `package.module:function` with the path of a cell description and the kind of cell.

    Raises SourceError with one line when it is not there, and what the factory raises.
    """
    module_name, _, attribute = name.partition(":")
    try:
        factory: Callable[[Path, str], CellSource] = getattr(import_module(module_name), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise SourceError(f"cell source {name!r}: {error}") from None
    return factory(description, kind)
