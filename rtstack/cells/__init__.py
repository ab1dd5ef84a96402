"""Cells by name: what a trial runs on, opened by a kind of this package or of any other that is installed."""

from rtstack.cells.description import default_cell_file, load_description
from rtstack.cells.kinds import CELLS, IDEAL, CellKind, CellRequest, kind_of, open_cell, profile_of, with_profile

__all__ = [
    "CELLS", "IDEAL", "CellKind", "CellRequest", "default_cell_file", "kind_of", "load_description", "open_cell",
    "profile_of", "with_profile",
]  # fmt: skip
