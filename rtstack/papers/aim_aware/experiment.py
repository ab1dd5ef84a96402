"""Experiment kinds of the collision-monitoring paper: impacts, each judged by every tuning."""

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.report import Report
from rtstack.papers.aim_aware.outline import Case, Portion, tuning_file
from rtstack.papers.aim_aware.study import StudyRun, load_run

P = TypeVar("P", bound=Portion[Any, Any])


def run_once(run: Callable[[P, Sequence[Case]], list[Row]], portion: P, case: Case) -> None:
    """Run one case, so that compiled code is in the cache before the workers start."""
    run(portion, [case])


class MonitorStudy(Experiment[P, Case]):
    """Common base of both studies. package: whose modules `worker` and `report` do the work, once they are needed."""

    unit = "simulations"
    package: ClassVar[str]

    @classmethod
    def part(cls, name: str) -> Any:
        """Return this module of the package."""
        return import_module(f"{cls.package}.{name}")

    def report(self, results: Results) -> Report:
        return self.part("report").report(self.specification, results)

    def stages(self) -> Stages:
        """Run one case before the others, so that code is compiled once."""
        run, first = self.part("worker").run_cases, next(self.specification.cases())
        yield Stage("compiling", [Task("compiling", run_once, (run, self.specification, first))])

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        return list(self.specification.cases())

    def tasks(self, cases: Sequence[Case]) -> Iterable[Task]:
        for _, some in groupby(cases, self.specification.batch_of):
            batch = tuple(some)
            yield Task(batch[0].id, self.part("worker").run_cases, (self.specification, batch), batch)

    def robot_s(self, row: Row) -> float:
        return self.specification.study.task.duration_s


class PlanarStudy(MonitorStudy[StudyRun]):
    """Section IV-A: a planar arm with three joints, simulated by rtstack.papers.aim_aware.planar."""

    package = "rtstack.papers.aim_aware"

    def __init__(self, specification: StudyRun, request: Request) -> None:
        sources = [tuning_file(specification.name)]  # without the plan file: rows do not depend on its claims
        super().__init__(specification, request, self.part("worker").columns(specification), sources)

    @classmethod
    def read(cls, path: Path, quick: bool) -> StudyRun:
        return load_run(path, quick)
