"""In which order a plan's cases run on arms, with pauses and control cases between them. The simulator needs none."""

import random
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import Annotated, Literal, TypeVar

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive
from rtstack.experiments.experiment import Case
from rtstack.trials.errors import TrialError

C = TypeVar("C", bound=Case)


@checked(frozen=True, slots=True, config=STRICT)
class CellSchedule:
    """The table `on_cell` of a plan: docs/howto/campaign.md. No row of the simulator depends on it.

    seed: of the order within the blocks. control: id of the case that is repeated at the beginning, every control_every
    cases and at the end, for the columns `drift`; warm_up: how often before everything. work_min, rest_min: pauses.
    failures_in_a_row: then the campaign stops. late_cycles: a case with more is run again, `attempts` times at most.
    placed_by: who sets the object in its place.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    control: str | None = None
    control_every: Annotated[int, Field(ge=1, le=1000)] = 20
    drift: tuple[str, ...] = ()
    warm_up: Annotated[int, Field(ge=0, le=100)] = 0
    work_min: Positive | None = None
    rest_min: NotNegative = 0.0
    failures_in_a_row: Annotated[int, Field(ge=1, le=1000)] = 10
    late_cycles: Annotated[int, Field(ge=0)] | None = None
    attempts: Annotated[int, Field(ge=1, le=10)] = 3
    placed_by: Literal["arms", "person"] = "arms"


def schedule_of(specification: object) -> CellSchedule:
    """Return the schedule of a plan: its field `on_cell`, and where it has none the default."""
    return getattr(specification, "on_cell", None) or CellSchedule()


def ordered(
    cases: Iterable[C], schedule: CellSchedule, digest: str, setup: Callable[[C], str] = lambda case: "",
    begin: str = "",
) -> list[C]:  # fmt: skip
    """Return all cases of a plan in the order in which they run, which a plan fixes. begin: how the cell is set up.

    A block is a repetition of everything, drawn, so that what drifts is spread over all conditions; in it cases of one
    set-up, which a person changes, follow each other, first those of the present one.
    """
    draw = random.Random(f"{digest}.{schedule.seed}")
    found: list[C] = []
    for _, block in groupby(sorted(cases, key=_block), key=_block):
        drawn = draw.sample(members := list(block), len(members))
        setups = list(dict.fromkeys([begin, *map(setup, drawn)]))
        found += sorted(drawn, key=lambda case: setups.index(setup(case)))
        begin = setup(found[-1])
    return found


def _block(case: Case) -> int:
    return getattr(case, "repetition", 0)


def control_case(cases: Sequence[C], schedule: CellSchedule) -> C | None:
    """Return the case that is repeated, None for none. Raises TrialError where the plan has none of this id."""
    if schedule.control is None:
        return None
    found = next((case for case in cases if case.id == schedule.control), None)
    if found is None:
        raise TrialError(f"key on_cell.control: the plan has no case {schedule.control}, but such as {cases[0].id}")
    return found
