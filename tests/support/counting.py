"""The smallest experiment there is: numbers that are counted, and one stage before them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from rtstack.experiments.claims import verdict_of
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.generic import mean_figure, mean_table
from rtstack.experiments.registration import Finding, PlannedClaim, Registration, check_claims, judged
from rtstack.experiments.report import Report, Section

PLAN = """kind = "counting"
name = "counting"
title = "Counting"
numbers = [1, 2, 3]
"""


@checked(frozen=True, slots=True, config=STRICT)
class Counting:
    """What is counted."""

    kind: str
    name: str
    title: str
    numbers: tuple[int, ...]
    quick: bool = False
    claims: tuple[PlannedClaim, ...] = (PlannedClaim("even", "1", "some are even"),)
    registration: Registration | None = None

    def size(self) -> int:
        """Return how many numbers there are."""
        return len(self.numbers)


@dataclass(frozen=True, slots=True)
class Number:
    """A number."""

    value: int

    @property
    def id(self) -> str:
        """Its name."""
        return f"number-{self.value}"


def prepare(out: Path) -> str | None:
    """Make what the numbers need."""
    (out / "ready").touch()
    return None


def count(out: Path, number: int) -> list[Row]:
    """Return a row; a file of the number's name makes it fail."""
    if (out / f"no-{number}").exists():
        raise ValueError(f"no {number}")
    assert (out / "ready").exists()
    return [{"id": Number(number).id, "number": number, "even": number % 2 == 0, "ticks": 1000}]


def even(rows: Sequence[Row], _at: object) -> Finding:
    """Judge that some numbers are even."""
    return Finding(f"{sum(row['even'] for row in rows)} of {len(rows)}", verdict_of(any(row["even"] for row in rows)))


JUDGES = {"even": even}


class CountingExperiment(Experiment[Counting, Number]):
    """Counts."""

    def __init__(self, specification: Counting, request: Request) -> None:
        columns = {"number": int, "even": bool, "ticks": int}
        super().__init__(specification, request, columns)

    @classmethod
    def read(cls, path: Path, quick: bool) -> Counting:
        """See Experiment."""
        counting = load_toml(path, Counting)
        check_claims(path, counting.claims, JUDGES)
        return counting

    def stages(self) -> Stages:
        """Make what the numbers need."""
        failed = yield Stage("looking for fingers", [Task("fingers", prepare, (self.request.out,))])
        assert failed == {}

    def cases(self, rows: Sequence[Row]) -> list[Number]:
        """Return the numbers; the last one once all others were counted."""
        numbers = [Number(value) for value in self.specification.numbers]
        return numbers if len(rows) >= len(numbers) - 1 else numbers[:-1]

    def tasks(self, cases: Sequence[Number]) -> Iterable[Task]:
        """Return a task for each."""
        return [Task(case.id, count, (self.request.out, case.value), (case,)) for case in cases]

    def report(self, results: Results) -> Report:
        """Return a generic table and figure, and a claim."""
        rows = results.rows
        table = mean_table("Numbers", rows, ("even",), {"number": "mean number"})
        figure = mean_figure("numbers.png", "The numbers.", rows, "number", "even", "number", "number")
        claims = judged(self.specification.claims, JUDGES, rows)
        return Report([Section("all", claims, [table], [figure])])
