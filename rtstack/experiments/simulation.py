"""A run on arms, on a simulated cell in a worker: a kind of experiment says each of its runs once."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import default_cell_file, open_cell
from rtstack.experiments.case_log import row_of
from rtstack.experiments.experiment import Case, CellRun, Experiment, Row, Task
from rtstack.trials.carry_out import Host, PreparedRun, R, carry_out
from rtstack.trials.record import RunLog
from rtstack.trials.run_context import NO_CONTEXT, RunContext


@dataclass(frozen=True, slots=True)
class WorkerHost(Host):
    """A campaign's worker as the host of a run (rtstack.trials.carry_out): a cell of its own, and no person.

    opened: opens it; kept: gives the log, None where nothing is written.
    """

    opened: Callable[[PreparedRun[Any]], Cell]
    kept: Callable[[PreparedRun[Any], Cell], RunLog | None]

    @contextmanager
    def cell(self, run: PreparedRun[Any]) -> Iterator[Cell]:
        with closing(self.opened(run)) as cell:
            yield cell

    @contextmanager
    def accompany(self, run: PreparedRun[Any], cell: Cell) -> Iterator[RunContext]:
        yield NO_CONTEXT

    def log(self, run: PreparedRun[Any], cell: Cell) -> RunLog | None:
        return self.kept(run, cell)


def simulate(planned: CellRun, kind: str, cell_file: Path | None = None) -> str | None:
    """Carry out a run on a simulated cell of a kind; returns why it failed, None for a success."""
    run, log = planned.run, planned.log
    log.parent.mkdir(exist_ok=True)
    log.unlink(missing_ok=True)
    return simulated(run, kind, cell_file, log, planned.record, planned.wanted).failure_reason


def simulated(
    run: PreparedRun[R], kind: str, cell_file: Path | None, log: Path | None, record: Mapping[str, str] | None = None,
    displacement: Displacement | None = None,
) -> R:  # fmt: skip
    """Carry out a run on a cell that is opened for it, and return its result. cell_file: of the run's description.

    log: the file to write, None for none; record: what it has of a campaign. displacement: by default the run's.
    """
    asked, file = run.specification, cell_file or default_cell_file()

    def opened(run: PreparedRun[Any]) -> Cell:
        wanted = displacement or run.displacement
        return open_cell(kind, asked.object, wanted, asked.seed, run.description, None, run.noise_seed, cell_file)

    def kept(run: PreparedRun[Any], cell: Cell) -> RunLog | None:
        return None if log is None else run.open_log(log, kind, file, cell, record)

    return carry_out(run, WorkerHost(opened, kept))


def simulated_tasks(experiment: Experiment[Any, Any], cases: Sequence[Case]) -> list[Task]:
    """Return a task for each case, which carries it out on a simulated cell."""
    return [Task(case.id, _rows, (experiment, case), (case,)) for case in cases]


def _rows(experiment: Experiment[Any, Any], case: Case) -> list[Row]:
    """Return the row of a case. Raises OSError where it has no complete log."""
    planned, request = experiment.planned(case), experiment.request
    reason = simulate(planned, request.simulated_cell, request.cell_file)
    row = row_of(experiment, case, planned.log)
    if row is None:
        raise OSError(reason or f"{planned.log} is not complete")
    return [row]
