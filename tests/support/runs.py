"""Demonstrations and trials as several tests run them: a simulated cell is opened, the run logged, the cell closed."""

from contextlib import closing
from pathlib import Path
from typing import Any

from rtstack.cells import default_cell_file, open_cell
from rtstack.model.cell_description import CellDescription
from rtstack.references.demonstration import Grab
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial

HOST = ("compute_us_p50", "compute_us_p99", "real_time_factor")  # what a row has of its machine


def demonstrate(
    log: Path,
    description: CellDescription,
    specification: DemonstrationSpecification | None = None,
    *,
    kind: str = "direct",
    file: Path | None = None,
    script: Grab | None = None,
    **around: Any,
) -> DemonstrationResult:
    """Record a demonstration. kind: of the cell; file: the description's; around: more of its RunContext."""
    specification = specification or DemonstrationSpecification()
    with closing(open_cell(kind, specification.object, 0.0, specification.seed, description)) as cell:
        writing = open_log(log, specification, description, kind, file or default_cell_file(), overwrite=True)
        return run_demonstration(specification, description, cell, RunContext(writing, **around), script=script)


def attempt(
    trial: TrialSpecification | PreparedTrial,
    description: CellDescription,
    log: Path | None = None,
    *,
    kind: str = "direct",
    file: Path | None = None,
    faults: Path | None = None,
    **around: Any,
) -> TrialResult:
    """Run a trial. kind: of the cell; file: the description's; faults: a script; around: more of its RunContext."""
    if isinstance(trial, TrialSpecification):
        asked, prepared = trial, prepare_trial(trial, description)
    else:
        asked, prepared = trial.specification, trial
    with closing(open_cell(kind, asked.object, asked.displacement, asked.seed, description, faults)) as cell:
        writing = None
        if log is not None:
            file = file or default_cell_file()
            writing = open_log(log, asked, description, kind, file, reference=prepared.reference, overwrite=True)
        return run_trial(prepared, cell, RunContext(writing, **around))


class StopAfter:
    """Asks for a stop from a tick on: a run looks at it once a tick."""

    def __init__(self, ticks: int) -> None:
        self._left = ticks

    @property
    def stop_requested(self) -> bool:
        """Whether that tick has come."""
        self._left -= 1
        return self._left < 0


def of_the_run(result: TrialResult, *more: str) -> dict[str, Any]:
    """Return what two equal runs have in common: no figure of the machine, no path of the log, none of `more`."""
    return {name: value for name, value in result.as_dict().items() if name not in (*HOST, "log", *more)}
