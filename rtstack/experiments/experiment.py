"""What a kind of experiment is, for the engine and for the author of an experiment.

A plan file (TOML) is read into a specification; the specification gives cases; a case is part of a task, which a worker
runs; a task gives a row for each of its cases; rows give a report. The engine does everything else: workers here or at
a Dask scheduler, what is missing after an interruption, retries, the table of results, progress, figures and page.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar, final

from hal.displacement import Displacement
from hal.extensions import package_of
from rtstack.experiments.plan_file import PlanFile, digest_of
from rtstack.experiments.report import Report
from rtstack.experiments.task import digests
from rtstack.trials.controllers import CONTROLLERS, DETECTORS
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.log.reader import Log
    from rtstack.trials.carry_out import PreparedRun

Row = dict[str, Any]
"""A row of the table of results: `id`, and a value for each column."""
DIRECT = "direct"  # the plant in the worker's process
SIMULATED = (DIRECT, "lockstep")


class Specification(Protocol):
    """A plan as its file has it, checked. quick: whether it is the sample that `--quick` runs."""

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def quick(self) -> bool: ...
    def size(self) -> int:
        """Number of cases."""
        ...


class Case(Protocol):
    """One row to be. id: unique among the cases of a plan, the same in every run of it, and the row's key."""

    @property
    def id(self) -> str: ...


@dataclass(frozen=True, slots=True)
class Task:
    """A call that a worker makes: `function(*arguments)`, both picklable, the function importable by name.

    A task with cases returns a list of rows, one for each case: id, and the experiment's columns. A task of a stage has
    no cases and returns None, or in one line why it failed. name: unique among the tasks of a plan.
    """

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    cases: tuple[Case, ...] = ()


@dataclass(frozen=True, slots=True)
class CellRun:
    """A case, or a part of a stage, as a run on a cell's arms.

    log: its file, absolute; record: what its log says of the campaign besides the case's id and the digest; wanted:
    where the object is to stand before it, from its nominal place, None without one; setup: what a person has to set up
    before it, as an imperative; clear: nothing may stand on the table.
    """

    run: "PreparedRun[Any]"
    log: Path
    record: Mapping[str, str] = field(default_factory=dict)
    wanted: Displacement | None = None
    setup: str = ""
    clear: bool = False


@dataclass(frozen=True, slots=True)
class Stage:
    """What has to be made before the cases can be run, such as references. label: what progress is called meanwhile.

    on_cell: where the campaign runs on arms, returns the run there in place of the task of a name, or raises
    ConfigurationError; None: workers make it there, too.
    """

    label: str
    tasks: Sequence[Task]
    on_cell: Callable[[str], CellRun] | None = None


Stages = Generator[Stage, dict[str, str], Any]
"""Yields stages, and is sent what failed in each of them: name of the task -> reason."""


@dataclass(frozen=True, slots=True)
class Request:
    """What was asked for on the command line. out: the campaign's folder, absolute; logs: an address that fsspec knows,
    for recordings and logs, where they are not to be in the folder; cell_file: a cell's description that is not the
    default one; profile: of the simulated robot, where it is not the plan's; data: a folder of measurements of others.
    cell: the kind on which it runs: direct, or lockstep, which gives the same rows, or arms at their addresses.
    """

    file: PlanFile
    out: Path
    logs: str | None = None
    cell_file: Path | None = None
    profile: str | None = None
    data: Path | None = None
    cell: str = DIRECT

    @property
    def simulated_cell(self) -> str:
        """The kind of cell that workers open: where the cases run on arms, for what is prepared without them."""
        return self.cell if self.cell in SIMULATED else DIRECT


@dataclass(frozen=True, slots=True)
class Results:
    """What a report is made of. rows: those of the plan's cases, in their order; out: the campaign's folder;
    preliminary: whether more will come, so that what takes long can be left out.
    """

    rows: list[Row]
    out: Path
    preliminary: bool = False


def _plug_ins(kind: type, specification: Any) -> list[str]:
    """Return name and version of the other packages that a plan's kind, controllers and detectors come from."""
    plan = json.dumps(asdict(specification), default=str)
    offered = [(point, name) for point in (CONTROLLERS, DETECTORS) for name in point.names()]
    named = (point.package(name) for point, name in offered if f'"{name}"' in plan)
    found = {" ".join(package) for package in named if package[0] != "rtstack"} | {package_of(kind.__module__)}
    return sorted(found - {""})


S = TypeVar("S", bound=Specification)
C = TypeVar("C", bound=Case)


class Experiment(ABC, Generic[S, C]):
    """A kind of experiment: a plug-in is a subclass. An instance of it is one campaign.

    An instance stays in the runner's process; only tasks go to the workers. The class is imported to list plans, too:
    what takes long to import (the controller, the simulator, Matplotlib) is better imported by the methods that need
    it.
    """

    # What of these options of the command line this kind takes: cell, logs, cell_file, profile, data.
    options: ClassVar[frozenset[str]] = frozenset()
    unit: ClassVar[str] = "trials"  # what the cases are called, in the plural
    made: ClassVar[tuple[str, ...]] = ()  # folders of what the stages make, in that of the campaign
    setup: ClassVar[str] = ""  # of a CellRun: how a simulated cell is set up when a campaign begins
    on_stack: ClassVar[bool] = True  # whether a stack's robot process can carry out the runs, too

    def __init__(
        self, specification: S, request: Request, columns: Mapping[str, Any] = {}, sources: Sequence[Path] = (),
        also: object = None,
    ) -> None:  # fmt: skip
        """columns: of the table of results, name -> type (str, int, float, bool, or one of these | None), beside those
        that the engine adds (id, git_commit, digest, wall_s, worker). sources: the files on which results depend; a
        worker that has others refuses to work.

        A subclass takes specification and request alone, checks all that can be checked, and raises ConfigurationError
        or TrialError with one line. It writes nothing: the campaign's folder is made later.
        """
        self.specification = specification
        self.request = request
        self.columns = columns
        self.sources = digests(sources)
        # of everything that a result depends on but code: a folder is resumed with the same digest only
        where = also if request.cell == DIRECT else (also, request.cell)
        plug_ins = _plug_ins(type(self), specification)
        self.digest = digest_of(specification, sources, (where, plug_ins) if plug_ins else where)

    @property
    def logged(self) -> bool:
        """Whether each row names its log, in the column of this name."""
        return "log" in self.columns

    @classmethod
    def plans(cls) -> Mapping[str, Path]:
        """Return the plans that this plug-in brings: name, as `rtstack campaign NAME` takes it -> file."""
        return {}

    @classmethod
    def composed(cls, values: Mapping[str, Any]) -> str:
        """Return the text of a plan file that a person asks for on the page Campaigns, by the form's values.

        Raises TrialError where plans of this kind are not made there.
        """
        raise TrialError(f"plans of the kind {cls.__name__} are written as a file")

    @classmethod
    @abstractmethod
    def read(cls, path: Path, quick: bool) -> S:
        """Read and check a plan file, its sample where `quick`. Raises ConfigurationError with one line."""

    def size(self) -> int:
        """Return how many cases there are to run; asked again once the stages are done."""
        return self.specification.size()

    def stages(self) -> Stages:
        """Yield what is to be made first, in order; only what is missing. May work here, in between.

        Raises TrialError where the cases cannot be run without what failed.
        """
        yield from ()

    @abstractmethod
    def cases(self, rows: Sequence[Row]) -> Sequence[C]:
        """Return the cases that are known with these results, in order; asked again once all of them were run."""

    def adopt(self, cases: Sequence[C]) -> Iterable[Row]:
        """Return rows of cases that were run, and logged, but not kept: the program was killed in between."""
        return ()

    def tasks(self, cases: Sequence[C]) -> Iterable[Task]:
        """Return the tasks that make the rows of these cases. By default none: each is run as `on_cell` has it."""
        return ()

    def on_cell(self, case: C) -> CellRun:
        """Return a case as a run on a cell, arms or simulated; its row then comes from its log, by `row_of_log`.

        Raises TrialError where this kind runs in the simulator alone, by `tasks` of its own.
        """
        raise TrialError(f"{self.specification.name} runs in the simulator alone: --cell direct, or lockstep")

    def row_of_log(self, case: C, log: "Log") -> Row:
        """Return the row of a case from its complete log: id, and the experiment's columns.

        Raises TrialError where this kind runs in the simulator alone: a kind defines `on_cell` and this, or neither.
        """
        raise TrialError(f"{type(self).__name__} defines no row_of_log: it runs in the simulator alone")

    @final
    def planned(self, case: C) -> CellRun:
        """Return a case as a run on a cell, whose log says of which campaign it is."""
        planned = self.on_cell(case)
        return replace(planned, record={**planned.record, "id": case.id, "digest": self.digest})

    @property
    def cell_file(self) -> Path | None:
        """The description of the arms on which the cases run, None for the default one."""
        return self.request.cell_file

    @classmethod
    def runs_on_cell(cls) -> bool:
        """Return whether cases of this kind can run on arms."""
        return cls.on_cell is not Experiment.on_cell and cls.row_of_log is not Experiment.row_of_log

    def robot_s(self, row: Row) -> float:
        """Return how many seconds of the robot's time a row took."""
        return 1e-3 * row.get("ticks", 0)

    def tidy(self) -> None:
        """Remove what workers that were killed have left. Called once the cases were run."""
        return

    @abstractmethod
    def report(self, results: Results) -> Report:
        """Return claims, tables and figures of these results."""
