"""The judge's limits of one trial: the hardware's, tightened by the cell, tightened by the trial, and never widened;
forces of the phases without an impact, where a cell says nothing of them, are FORCES_BY_PHASE.

They come from files that are named when the program starts. No request that arrives over a socket has a field for them.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from hal.cell import Cell
from hal.limits import OwnLimits
from hal.robots import ROBOTS, RobotModel
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import FORCES_BY_PHASE, LimitWidened, PairLimits, hardware_limits, within_own
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import Tightening


@checked(frozen=True, slots=True, config=STRICT)
class _File:
    safety: dict[str, Any]


def load_tightening(path: Path) -> Tightening:
    """Read the table `[safety]` of a TOML, spelt as a cell's; `limits_of_arms` checks it. Raises ConfigurationError."""
    table = load_toml(path, _File).safety
    return tuple((key, tuple(value) if isinstance(value, list) else value) for key, value in sorted(table.items()))


def limits_of_cell(limits: PairLimits, cell: Cell) -> PairLimits:
    """Return the limits of an open cell's arms: inside those that its robots say they have, where they were asked."""
    if cell.own_limits is None:
        return limits
    return tuple(within_own(one, own)[0] for one, own in zip(limits, cell.own_limits, strict=True))


def difference_of_limits(description: CellDescription, own: Sequence[OwnLimits] | None) -> str:
    """Return in one line where robots say that they have other limits than their models, "" where they do not."""
    if own is None:
        return ""
    found = [
        f"{side}: {'; '.join(differs)}"
        for side, limits, one in zip(description.sides, limits_of_arms(description), own, strict=True)
        if (differs := within_own(limits, one)[1])
    ]
    return f"the robots' own limits differ, and the tighter ones hold: {', '.join(found)}" if found else ""


def check_models(description: CellDescription, own: Sequence[OwnLimits] | None) -> None:
    """Raise TrialError where a robot's joints have a range that the described model leaves, and another one is nearer
    to."""
    for side, model, one in zip(description.sides, description.robots, own or (), strict=False):
        stays = np.all(model.limits.q_lower >= one.q_lower) and np.all(model.limits.q_upper <= one.q_upper)
        if stays:
            continue
        nearest = min(ROBOTS.loadable()[0].values(), key=lambda each: _apart(each, one))
        if _apart(nearest, one) < _apart(model, one):
            raise TrialError(
                f"the {side} arm has the joint limits of {nearest.title}, and the cell's file has model "
                f"{model.name!r}: correct [{side}] model, or the address"
            )


def _apart(model: RobotModel, own: OwnLimits) -> float:
    """Return by how much the range of a joint differs at most, rad."""
    limits = model.limits
    return float(max(np.abs(limits.q_lower - own.q_lower).max(), np.abs(limits.q_upper - own.q_upper).max()))


def limits_of_arms(description: CellDescription, tightening: Tightening = ()) -> PairLimits:
    """Return the limits of each arm in a trial on a cell. Raises TrialError with the first one that would be wider."""
    try:
        return tuple(
            hardware_limits(model).tightened(FORCES_BY_PHASE | description.safety).tightened(dict(tightening))
            for model in description.robots
        )
    except LimitWidened as error:
        raise TrialError(f"{error} (cell {description.name})") from None
