"""Models of robots as data: a TOML and a URDF each. Ours are registered as any package's are (group rtstack.robots).

FR3: the Franka Research 3, which a cell has unless its file says otherwise. FER: its predecessor, the Panda.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

from hal.extensions import ExtensionError, ExtensionPoint
from hal.robots.model import RobotError, RobotModel, read_robot

__all__ = ["DEFAULT", "FER", "FR3", "ROBOTS", "RobotError", "RobotModel", "read_robot", "reference_in", "robot"]

ROBOTS = ExtensionPoint("rtstack.robots", "robot model", RobotModel)
DEFAULT = "fr3"


FR3 = replace(read_robot(Path(__file__).with_name("fr3.toml")), reference="fr3")
"""The Franka Research 3."""
FER = replace(read_robot(Path(__file__).with_name("fer.toml")), reference="fer")
"""Its predecessor, the Panda."""


def reference_in(cell_file: Path, model: str) -> str:
    """Return a cell file's `model` as `robot` takes it everywhere: a name, or a TOML's path from the file's folder."""
    return str(cell_file.resolve().parent / model) if model.endswith(".toml") else model


@cache
def robot(reference: str = DEFAULT) -> RobotModel:
    """Return the model of a registered name, or of a TOML's path: always the same object for the same reference.

    Raises RobotError with one line.
    """
    if reference == DEFAULT:  # whatever is installed
        return FR3
    if reference.endswith(".toml"):
        return read_robot(Path(reference))
    try:
        found = ROBOTS.load(reference)
    except ExtensionError as error:
        raise RobotError(f"{error}, or the path of a TOML") from error
    return found if found.reference == reference else replace(found, reference=reference)
