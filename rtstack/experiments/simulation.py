"""A run on arms, on a simulated cell in a worker: a kind of experiment says each of its runs once."""

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.cell import Cell
from rtstack.cells import load_description, open_cell
from rtstack.experiments.case_log import row_of
from rtstack.experiments.experiment import Case, CellRun, Experiment, Row, Task
from rtstack.trials.carry_out import PreparedRun, carry_out
from rtstack.trials.record import TrialLog
from rtstack.trials.run_context import NO_CONTEXT, RunContext


@dataclass(frozen=True, slots=True)
class _Simulation:
    """See rtstack.trials.carry_out.Host. The object stands where the run wants it."""

    planned: CellRun
    kind: str
    cell_file: Path | None

    @contextmanager
    def cell(self, run: PreparedRun) -> Iterator[Cell]:
        asked, wanted = run.specification, self.planned.wanted or run.displacement
        with closing(open_cell(
            self.kind, asked.object, wanted, asked.seed, run.description, None, run.noise_seed, self.cell_file
        )) as cell:  # fmt: skip
            yield cell

    def warn(self, text: str) -> None:
        pass

    @contextmanager
    def accompany(self, run: PreparedRun, cell: Cell) -> Iterator[RunContext]:
        yield NO_CONTEXT

    def log(self, run: PreparedRun, cell: Cell) -> TrialLog:
        file = load_description(self.cell_file, self.kind)[1]
        self.planned.log.unlink(missing_ok=True)
        return run.open_log(self.planned.log, self.kind, file, cell, self.planned.record)


def simulate(planned: CellRun, kind: str, cell_file: Path | None = None) -> str | None:
    """Carry out a run on a simulated cell of a kind; returns why it failed, None for a success."""
    planned.log.parent.mkdir(exist_ok=True)
    return carry_out(planned.run, _Simulation(planned, kind, cell_file)).failure_reason


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
