"""A sweep: every combination of shifts, turns, controllers, objects and seeds, as trials of the queue.

Numbers are written as -60:10:60 (first, step, last), as 0:4 (with a step of 1), or one by one: -30, 0, 30.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.queue.entry import TrialOrder
from rtstack.live.protocol import ObjectName
from rtstack.messages import MESSAGE
from rtstack.samples import Reaction
from rtstack.trials.controllers import DEFAULT, ControllerName

MOST_VALUES = 500
MOST_SHIFT_MM, _MOST_TURN_DEG, _MOST_SEED = 1000.0, 180.0, 2**31 - 1

# what parses is said by `numbers`, in one line that names the field
Numbers = Annotated[str, Field(min_length=1, max_length=400)]


class SweepRefused(Exception):
    """A sweep that cannot be. The message is one line that begins with the field's name."""


@checked(frozen=True, slots=True, config=MESSAGE)
class SweepOrder:
    """Each controller with each object at each shift and turn, with each seed; the controllers of a place follow one
    another. Shifts in mm along the world's y and x, turns in degrees about z: numbers such as -60:10:60 or 0, 15.
    """

    reference: Annotated[str, Field(min_length=1, max_length=128)]
    objects: Annotated[tuple[ObjectName, ...], Field(min_length=1, max_length=32)]
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1, max_length=32)] = (DEFAULT,)
    displacements_mm: Numbers = "0"
    displacements_x_mm: Numbers = "0"
    yaws_deg: Numbers = "0"
    seeds: Numbers = "0"
    reaction: Reaction = Reaction.CONTINUE

    def trials(self) -> list[TrialOrder]:
        """Return the trials in the order in which they will run. Raises SweepRefused."""
        places = product(
            numbers("displacements_mm", self.displacements_mm, MOST_SHIFT_MM),
            numbers("displacements_x_mm", self.displacements_x_mm, MOST_SHIFT_MM),
            numbers("yaws_deg", self.yaws_deg, _MOST_TURN_DEG),
        )
        seeds = whole("seeds", self.seeds)
        combinations = list(product(dict.fromkeys(self.objects), places, seeds, dict.fromkeys(self.controllers)))
        return [
            TrialOrder(self.reference, thing, controller, y_mm, x_mm, yaw_deg, seed, self.reaction)
            for thing, (y_mm, x_mm, yaw_deg), seed, controller in combinations
        ]


@dataclass(frozen=True, slots=True)
class SweepSize:
    """How many trials a sweep is, and how many more the queue has room for."""

    trials: int
    room: int


def numbers(field: str, text: str, most: float) -> list[float]:
    """Return the numbers of a text, each once, in its order. Raises SweepRefused with the field's name."""
    found: list[float] = []
    for part in text.replace(",", " ").split():
        found += _range(field, part)
        if len(found) > MOST_VALUES:
            raise SweepRefused(f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    if not found:
        raise SweepRefused(f"{field}: give a number, a list such as -30, 0, 30, or first:step:last such as -60:10:60")
    for value in found:
        if abs(value) > most:
            raise SweepRefused(f"{field}: {value:g} is beyond {most:g}")
    return list(dict.fromkeys(found))


def whole(field: str, text: str) -> list[int]:
    """Return the whole numbers of a text that are not negative, as `numbers` does. Raises SweepRefused."""
    values = numbers(field, text, _MOST_SEED)
    for value in values:
        if value != int(value) or value < 0:
            raise SweepRefused(f"{field}: {value:g}: give whole numbers from 0 on, such as 0:4")
    return [int(value) for value in values]


def _range(field: str, part: str) -> Sequence[float]:
    try:
        values = [float(number) for number in part.split(":")]
    except ValueError:
        values = []
    if not 1 <= len(values) <= 3 or not all(map(math.isfinite, values)):
        raise SweepRefused(f"{field}: {part[:40]!r} is none: give a number, or first:step:last such as -60:10:60")
    if len(values) == 1:
        return values
    first, last = values[0], values[-1]
    step = values[1] if len(values) == 3 else 1.0
    if step == 0.0 or (last - first) / step < 0.0:
        raise SweepRefused(f"{field}: {part}: steps of {step:g} do not lead from {first:g} to {last:g}")
    steps = math.floor((last - first) / step + 1e-9)
    if steps >= MOST_VALUES:
        raise SweepRefused(f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    return [round(first + k * step, 9) for k in range(steps + 1)]
