"""The judge's limits of one trial: the hardware's, tightened by the cell, tightened by the trial, and never widened.

They come from files that are named when the program starts. No request that arrives over a socket has a field for them.
"""

from pathlib import Path
from typing import Any

from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, load_toml
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import LimitWidened, PairLimits, SafetyLimits, hardware_limits
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import Tightening


@checked(frozen=True, slots=True, config=STRICT)
class _File:
    safety: dict[str, Any]


def load_tightening(path: Path) -> Tightening:
    """Read the table `[safety]` of a TOML, spelt as in a cell's. Raises ConfigurationError; the values are not checked
    before `safety_limits`."""
    table = load_toml(path, _File).safety
    return tuple((key, tuple(value) if isinstance(value, list) else value) for key, value in sorted(table.items()))


def safety_limits(description: CellDescription, tightening: Tightening = (), side: int = 0) -> SafetyLimits:
    """Return the limits of the left (0) or right (1) arm in a trial on a cell. Raises as `limits_of_arms` does."""
    return limits_of_arms(description, tightening)[side]


def limits_of_arms(description: CellDescription, tightening: Tightening = ()) -> PairLimits:
    """Return the limits of both arms in a trial on a cell. Raises TrialError with the first one that would be wider."""
    try:
        left, right = (
            hardware_limits(model).tightened(description.safety).tightened(dict(tightening))
            for model in description.robots
        )
        return left, right
    except LimitWidened as error:
        raise TrialError(f"{error} (cell {description.name})") from None
