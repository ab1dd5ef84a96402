"""What the studies share: a plan with a count of seeds, a case for each seed and variant, a row for each case."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Task
from rtstack.experiments.report import Report, Section, Table

QUICK = 2  # seeds of `--quick`


@checked(frozen=True, slots=True, config=STRICT)
class Plan:
    """A plan's file. seeds: how many, from `first` on; variants: what is done with each of them."""

    kind: str
    name: str
    title: str
    seeds: Annotated[int, Field(ge=1)]
    first: int = 0
    variants: tuple[str, ...] = ("",)
    quick: bool = False

    def size(self) -> int:
        """Return the number of cases."""
        return self.seeds * len(self.variants)


@dataclass(frozen=True, slots=True)
class Case:
    """A seed and what is done with it."""

    seed: int
    variant: str = ""

    @property
    def id(self) -> str:
        """SEED, or SEED.VARIANT."""
        return f"{self.seed}.{self.variant}" if self.variant else str(self.seed)


class Study(Experiment[Plan, Case]):
    """A study. A subclass has COLUMNS, `run` and `tables`; its plan is the .toml beside its module."""

    COLUMNS: ClassVar[Mapping[str, Any]]

    def __init__(self, specification: Plan, request: Request) -> None:
        super().__init__(specification, request, {"seed": int, "variant": str, **self.COLUMNS}, [request.file.path])

    @classmethod
    def read(cls, path: Path, quick: bool) -> Plan:
        """See Experiment."""
        plan = load_toml(path, Plan)
        return replace(plan, seeds=min(plan.seeds, QUICK), quick=True) if quick else plan

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """Return each variant of each seed."""
        plan = self.specification
        return [Case(plan.first + k, variant) for k in range(plan.seeds) for variant in plan.variants]

    def tasks(self, cases: Sequence[Case]) -> Iterable[Task]:
        """Return a task for each case."""
        return [Task(case.id, row_of, (type(self), self.request.out, case), (case,)) for case in cases]

    @staticmethod
    @abstractmethod
    def run(out: Path, case: Case) -> Row:
        """Return the row of a case, without id, seed and variant. out: the campaign's folder."""

    @abstractmethod
    def tables(self, rows: Sequence[Row]) -> tuple[list[Table], list[str]]:
        """Return the tables, and a line for everything that is not as it should be."""

    def report(self, results: Results) -> Report:
        """Return the tables; they are also printed. Not reached where something is not as it should be."""
        tables, wrong = self.tables(results.rows)
        summary = "\n".join(line for table in tables for line in _text(table))
        section = Section(self.specification.title, tables=tables)
        return Report([section], summary=summary, warnings=wrong, reached=not wrong)


def row_of(study: type[Study], out: Path, case: Case) -> list[Row]:
    """Return the row of a case, in a list as the engine takes it."""
    return [{"id": case.id, "seed": case.seed, "variant": case.variant} | study.run(out, case)]


def _text(table: Table) -> list[str]:
    lines = [list(table.headings), *map(list, table.lines)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.headings))]
    return [table.title, *(_line(line, widths) for line in lines)]


def _line(words: list[str], widths: list[int]) -> str:
    return "  ".join(word.ljust(n) for word, n in zip(words, widths, strict=True)).rstrip()
