"""The object that a run is asked to be about."""

from pathlib import Path

from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.references.planned import PLAN
from rtstack.trials.errors import TrialError


def check_object(name: str, description: CellDescription) -> None:
    """Raise TrialError for an object that the cell does not have."""
    if name not in description.objects:
        known = ", ".join(description.objects)
        raise TrialError(
            f"unknown object {name!r}: the cell {description.name} has {known}; define another one as "
            f"[objects.{name}] in the cell's file (--cell-file)"
        )


def check_two_arms(description: CellDescription, what: str) -> None:
    """Raise TrialError where a cell has one arm; what: the run, which is made by two."""
    if len(description.arms) == 1:
        raise TrialError(
            f"{what} takes two arms, and the cell {description.name} has the {description.sides[0]} one alone: "
            "give a cell's file, and addresses, of two"
        )


def object_of(reference: Path) -> str:
    """Return the object that a recording or a plan is about. Raises TrialError or LogError with one line."""
    metadata = read_log(reference).metadata
    name = (metadata.get(PLAN) or metadata.get("trial", {})).get("object", "")
    if not name:
        raise TrialError(f"{reference}: it was made without an object: follow another one, or give --object")
    return name
