"""Where the robot process gets its cell from: a factory that a composition root hands over by its name."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol

from hal.cell import Cell


class OpenCell(Protocol):
    """Open a cell with an object in it, displaced along the world's y, m.

    Each call gives a fresh cell; the caller closes it. Raises hal.errors.HardwareError with one clear line.
    """

    def __call__(self, object_name: str, displacement_m: float, seed: int) -> Cell: ...


@dataclass(frozen=True, slots=True)
class CellObject:
    """An object that the cell can be given: its name, and its box (length, width, height) in m for drawing it."""

    name: str
    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Fixture:
    """A box that stands in the cell for good, such as a table: its centre in the world and its size, m."""

    name: str
    centre_m: tuple[float, float, float]
    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CellSource:
    """A kind of cell: how it is called, whether it is simulated, what it holds or can hold, and how to open one."""

    name: str
    simulated: bool
    objects: tuple[CellObject, ...]
    fixtures: tuple[Fixture, ...]
    open_cell: OpenCell


class SourceError(Exception):
    """The name of the factory leads nowhere; the message says where it broke off."""


def load_source(name: str, description: Path | None) -> CellSource:
    """Call the factory `package.module:function` with the path of a cell description, None for the default cell.

    Raises SourceError with one line.
    """
    module_name, _, attribute = name.partition(":")
    try:
        factory: Callable[[Path | None], CellSource] = getattr(import_module(module_name), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise SourceError(f"cell source {name!r}: {error}") from None
    return factory(description)
