"""Demonstrations that the trials of a campaign follow: how a worker records them, and what all its trials share."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import with_profile
from rtstack.experiments.archive import Archive
from rtstack.experiments.experiment import Stage, Task
from rtstack.experiments.seeds import seed_of
from rtstack.log.job import Attachment
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.papers.conditions import Conditions
from rtstack.papers.reference import Reference
from rtstack.papers.simulated_cell import open_conditioned_cell
from rtstack.safety.limits import HARDWARE
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import cell_attachments, frames, trial_metadata
from rtstack.trials.run_context import RunContext
from rtstack.trials.scoring import SuccessCriterion
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.whole_run_log import WholeRunLog

CELL = "direct"
RECORDINGS = "references"
LOGS = "logs"


# Without a person in the cell a demonstration may hit as hard as a trial: plans ask for faster ones than the judge lets
# hands make (rtstack.safety.limits). What the cell's file says holds.
_AS_AN_IMPACT = {name: getattr(HARDWARE, name) for name in ("tau_ext_contact_max", "force_contact_max")}


@dataclass(frozen=True, slots=True)
class Bench:
    """What all trials of a campaign have in common, as it is sent to the workers.

    Paths are absolute: workers on other machines need the same folders. elsewhere: where recordings and logs are, if
    not in `out`: an address that fsspec knows. digest: the campaign's, for the logs. lab_file: a cell_file with objects
    of its own.
    """

    out: Path
    cell_file: Path
    criterion: SuccessCriterion
    digest: str
    elsewhere: str | None = None
    lab_file: Path | None = None

    @property
    def archive(self) -> Archive:
        """Where recordings and logs are."""
        return Archive(self.elsewhere or str(self.out))

    def open_cell(self, object_name: str, displacement: Displacement, seed: int, conditions: Conditions) -> Cell:
        """Open the simulated cell of a trial."""
        return open_conditioned_cell(object_name, displacement, seed, conditions, cell_file=self.lab_file)

    @property
    def description(self) -> CellDescription:
        """The cell, read once in a process."""
        return _description(self.cell_file)


@lru_cache(maxsize=4)
def _description(cell_file: Path) -> CellDescription:
    return load_cell_description(cell_file)


@lru_cache(maxsize=1)
def common_attachments(cell_file: Path) -> list[Attachment]:
    """Return what every log of a campaign has attached."""
    return cell_attachments(cell_file, load_cell_description(cell_file))


def record(bench: Bench, reference: Reference, conditions: Conditions, seed: int) -> str | None:
    """Record a demonstration. Returns None, or in one line why there is none."""
    description = replace(bench.description, safety=_AS_AN_IMPACT | bench.description.safety)
    specification = DemonstrationSpecification(reference.object, reference.variation, seed, reference.speed_m_s)
    metadata = {"trial": trial_metadata(specification, with_profile(CELL, conditions.profile), None)}
    with bench.archive.new(f"{RECORDINGS}/{reference.file}") as path:
        log = WholeRunLog(
            path, metadata, common_attachments(bench.cell_file),
            frames(description, reference.object),
        )  # fmt: skip
        cell = bench.open_cell(reference.object, Displacement(), seed, conditions)
        try:
            return run_demonstration(specification, description, cell, RunContext(log)).failure_reason
        finally:
            cell.close()


def recording_stages(
    bench: Bench, references: Iterable[Reference], conditions: Conditions, seed: int
) -> Generator[Stage, dict[str, str], dict[str, str]]:
    """Record the references that are missing; seed: the plan's. Returns why, of those that cannot be recorded."""
    there = bench.archive.names(RECORDINGS)
    missing = [reference for reference in references if reference.file not in there]
    tasks = [
        Task(f"reference-{one.name}", record, (bench, one, conditions, seed_of(seed, "reference", one.name)))
        for one in missing
    ]
    failed = yield Stage("references", tasks)
    unrecorded = {one.name: failed[task.name] for one, task in zip(missing, tasks, strict=True) if task.name in failed}
    for name in unrecorded:
        bench.archive.remove(f"{RECORDINGS}/{Reference.named(name).file}")
    return unrecorded
