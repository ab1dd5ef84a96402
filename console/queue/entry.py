"""An entry of the queue: a trial with its state; and a sweep, which is many.

Numbers are written as -60:10:60 (first, step, last), as 0:4 (with a step of 1), or one by one: -30, 0; 30.
"""

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields, make_dataclass
from enum import StrEnum
from itertools import product
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.orders import LogId, TrialOrder
from console.refused import Refused
from rtstack.log_folder.log_rows import Ending
from rtstack.messages import MESSAGE, NUMBER, StrictFloat
from rtstack.trials.controllers import DEFAULT, ControllerName
from rtstack.trials.specification import MOST_SEED, MOST_SHIFT_MM, MOST_TURN_DEG, ObjectName, like

MAX_REPETITIONS = 200
MOST_VALUES = 500

# what parses is said by `numbers`, in one line that names the field
Numbers = Annotated[str, Field(min_length=1, max_length=400)]


@checked(frozen=True, slots=True, config=MESSAGE)
class QueueOrder:
    """The same trial so many times, each with the next seed: `seed`, `seed` + 1, ..."""

    trial: TrialOrder
    repetitions: Annotated[int, Field(ge=1, le=MAX_REPETITIONS), NUMBER] = 1


class EntryState(StrEnum):
    """Where an entry is. The last four are final."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    CANCELLED = "cancelled"


@checked(frozen=True, slots=True, config=MESSAGE)
class Entry:
    """One trial of the queue. `followed`: what a person calls its reference; `repetition` of the `repetitions` that
    were added together, from 1; job: its number in the robot process, None before it has one; began_s: Unix time;
    duration_s: from the order to both arms at rest; reason: why it did not succeed; log: the id of its log; ending: as
    the list of logs says it.
    """

    id: str
    trial: TrialOrder
    followed: str
    repetition: Annotated[int, NUMBER] = 1
    repetitions: Annotated[int, NUMBER] = 1
    state: EntryState = EntryState.WAITING
    job: Annotated[int, NUMBER] | None = None
    began_s: StrictFloat | None = None
    duration_s: StrictFloat | None = None
    reason: str | None = None
    log: str | None = None
    ending: Ending | None = None

    @property
    def final(self) -> bool:
        """Whether nothing more becomes of it."""
        return self.state not in (EntryState.WAITING, EntryState.RUNNING)


@dataclass(frozen=True, slots=True)
class QueueView:
    """The queue as everybody sees it. `operator`: on whose word it runs, None while it is paused, for this `reason`.

    past_failures: whether it goes on past grabs that do not succeed. time_left_s: from the durations of the trials that
    have ended, None where none has.
    """

    running: bool
    operator: str | None
    reason: str | None
    past_failures: bool
    time_left_s: float | None
    entries: tuple[Entry, ...]


_VARIED = ("object", "controller", "displacement_mm", "displacement_x_mm", "yaw_deg", "seed")
# what all trials of a sweep have in common: every other field of a trial
_SHARED = [each for each in fields(TrialOrder) if each.name not in _VARIED and each.default is not MISSING]
_KEPT = [(each.name, each.type, field(default=each.default)) for each in _SHARED]
_Common: Any = make_dataclass("_Common", _KEPT, kw_only=True, frozen=True, slots=True)


@checked(frozen=True, slots=True, config=MESSAGE)
class SweepOrder(_Common):
    """Each controller with each object at each shift and turn, with each seed; the controllers of a place follow one
    another. Shifts in mm along the world's y and x, turns in degrees about z: numbers such as -60:10:60 or 0, 15.
    """

    reference: LogId
    objects: Annotated[tuple[ObjectName, ...], Field(min_length=1, max_length=32)]
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1, max_length=32)] = (DEFAULT,)
    displacements_mm: Numbers = "0"
    displacements_x_mm: Numbers = "0"
    yaws_deg: Numbers = "0"
    seeds: Numbers = "0"

    def trials(self) -> list[TrialOrder]:
        """Return the trials in the order in which they will run. Raises Refused."""
        most = {"displacements_mm": MOST_SHIFT_MM, "displacements_x_mm": MOST_SHIFT_MM, "yaws_deg": MOST_TURN_DEG}
        places = product(*(numbers(name, getattr(self, name), limit) for name, limit in most.items()))
        seeds = whole("seeds", self.seeds)
        combinations = product(dict.fromkeys(self.objects), places, seeds, dict.fromkeys(self.controllers))
        varied = [(thing, controller, *place, seed) for thing, place, seed, controller in combinations]
        return [like(TrialOrder, self, **dict(zip(_VARIED, values, strict=True))) for values in varied]


@dataclass(frozen=True, slots=True)
class SweepSize:
    """How many trials a sweep is, and how many more the queue has room for."""

    trials: int
    room: int


def numbers(field: str, text: str, most: float) -> list[float]:
    """Return the numbers of a text, each once, in its order. Raises Refused with the field's name."""
    found: list[float] = []
    for part in text.replace(";", " ").replace(", ", " ").split():
        found += _range(field, part)
        if len(found) > MOST_VALUES:
            raise Refused(422, f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    if not found:
        raise Refused(422, f"{field}: give a number, a list such as -30, 0, 30, or first:step:last such as -60:10:60")
    for value in found:
        if abs(value) > most:
            raise Refused(422, f"{field}: {value:g} is beyond {most:g}")
    return list(dict.fromkeys(found))


def whole(field: str, text: str) -> list[int]:
    """Return the whole numbers of a text that are not negative, as `numbers` does. Raises Refused."""
    values = numbers(field, text, MOST_SEED)
    for value in values:
        if value != int(value) or value < 0:
            raise Refused(422, f"{field}: {value:g}: give whole numbers from 0 on, such as 0:4")
    return [int(value) for value in values]


def _range(field: str, part: str) -> Sequence[float]:
    try:
        values = [float(number) for number in part.split(":")]
    except ValueError:
        values = []
    if not 1 <= len(values) <= 3 or not all(map(math.isfinite, values)):
        raise Refused(422, f'{field}: "{part[:40]}" is not a list: write -12.5, 5 or -60:10:60')
    if len(values) == 1:
        return values
    first, last = values[0], values[-1]
    step = values[1] if len(values) == 3 else 1.0
    if step == 0.0 or (last - first) / step < 0.0:
        raise Refused(422, f"{field}: {part}: steps of {step:g} do not lead from {first:g} to {last:g}")
    steps = math.floor((last - first) / step + 1e-9)
    if steps >= MOST_VALUES:
        raise Refused(422, f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    return [round(first + k * step, 9) for k in range(steps + 1)]
