"""The description of a cell: the simulated grabbing cell's, or a file of the user's."""

from importlib.resources import as_file, files
from pathlib import Path

from rtstack import refuse_shadows
from rtstack.model.cell_description import CellDescription, load_cell_description


def default_cell_file() -> Path:
    """Return the path of the description of the simulated grabbing cell."""
    refuse_shadows("deploy")
    with as_file(files("deploy.cells") / "grab.toml") as path:
        return path


def load_description(path: Path | None, kind: str = "") -> tuple[CellDescription, Path]:
    """Return the cell's description and the file that it came from. Raises ConfigurationError.

    kind: of the cell that is opened: fci:LEFT or fci:,RIGHT is one arm of a cell that may have two.
    """
    source = path or default_cell_file()
    return of_arms(load_cell_description(source), kind), source


def of_arms(description: CellDescription, kind: str) -> CellDescription:
    """Return the description with the arms alone that a kind of cell has; see `load_description`."""
    scheme, _, addresses = kind.partition(":")
    if scheme != "fci":
        return description
    left, _, right = addresses.partition(",")
    asked = [side for side, address in (("left", left), ("right", right)) if address]
    there = [side for side in asked if side in description.mountings]
    return description.only(there) if there and there == asked else description
