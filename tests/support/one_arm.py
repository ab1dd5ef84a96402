"""A cell of one arm: the file of the grabbing cell without the table of the other one."""

import re
from pathlib import Path

from rtstack.cells import default_cell_file
from rtstack.samples import SIDES


def one_arm_file(folder: Path, side: str, more: str = "", source: Path | None = None) -> Path:
    """Write folder/`side`.toml and return it. more: text after the file's own; source: a cell's file of two arms, by
    default the grabbing cell's."""
    text = (source or default_cell_file()).read_text(encoding="utf-8")
    other = SIDES[1 - SIDES.index(side)]
    text = re.sub(rf"^\[{other}\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.MULTILINE)
    path = folder / f"{side}.toml"
    path.write_text(text + more, encoding="utf-8")
    return path
