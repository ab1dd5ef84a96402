"""The description of a cell: the simulated grabbing cell's, or a file of the user's."""

from importlib.resources import as_file, files
from pathlib import Path

from rtstack.model.cell_description import CellDescription, load_cell_description


def default_cell_file() -> Path:
    """Return the path of the description of the simulated grabbing cell."""
    with as_file(files("deploy.cells") / "grab.toml") as path:
        return path


def load_description(path: Path | None) -> tuple[CellDescription, Path]:
    """Return the cell's description and the file that it came from. Raises ConfigurationError."""
    source = path or default_cell_file()
    return load_cell_description(source), source
