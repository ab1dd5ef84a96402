"""What a worker does: record a demonstration, or run a trial and write its log. One row of plain values comes back.

Everything that trials share (cell, references, what is compiled) is kept from one to the next.
"""

import gc
import hashlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

from hal.cell import Cell
from hal.description import fr3_urdf
from hal.displacement import Displacement
from rtstack.campaign.archive import Archive
from rtstack.campaign.measures import Measures, measure
from rtstack.campaign.plan import Conditions
from rtstack.campaign.trial import Reference, Trial
from rtstack.campaign.trial_log import WholeRunLog
from rtstack.log.job import Attachment
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.trials.company import Company
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.provenance import git_commit
from rtstack.trials.record import frames, trial_metadata
from rtstack.trials.result import TrialResult
from rtstack.trials.scoring import SuccessCriterion
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial

CELL = "direct"
RECORDINGS = "references"
LOGS = "logs"

OpenCell = Callable[[str, Displacement, int, Conditions], Cell]
Row = dict[str, object]


class WorkerMismatch(Exception):
    """A worker that would compute something else than the others: another version, or other files."""


@dataclass(frozen=True, slots=True)
class Bench:
    """What all trials of a campaign have in common, as it is sent to the workers.

    open_cell: object, displacement, seed, conditions -> cell; sources: the files on which results depend, as the
    campaign's digest has them. Paths are absolute: workers on other machines need the same folders. elsewhere: where
    recordings and logs are, if not in `out`: an address that fsspec knows.
    """

    out: Path
    cell_file: Path
    open_cell: OpenCell
    criterion: SuccessCriterion
    digest: str
    sources: tuple[tuple[Path, str], ...]
    elsewhere: str | None = None

    @property
    def archive(self) -> Archive:
        """Where recordings and logs are."""
        return Archive(self.elsewhere or str(self.out))


def digests(paths: Sequence[Path]) -> tuple[tuple[Path, str], ...]:
    """Return each file with the digest of its content."""
    return tuple((path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in paths)


def check_sources(sources: Sequence[tuple[Path, str]]) -> None:
    """Raise WorkerMismatch where a file is another one here than where the campaign was begun."""
    for path, digest in sources:
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise WorkerMismatch(f"a worker on {os.uname().nodename} has another {path} than the campaign")


@lru_cache(maxsize=4)
def _description(bench: Bench) -> CellDescription:
    """The cell, once it is clear that this process would compute the same as all others."""
    check_sources(bench.sources)
    gc.freeze()  # what is imported stays: collections need not look at it after every log
    return load_cell_description(bench.cell_file)


@lru_cache(maxsize=32)
def _prepared(bench: Bench, reference: Reference) -> PreparedTrial:
    path = bench.archive.file(f"{RECORDINGS}/{reference.file}")
    return prepare_trial(TrialSpecification(str(path), object=reference.object), _description(bench))


@lru_cache(maxsize=1)
def common_attachments(cell_file: Path) -> list[Attachment]:
    """Return what every log of a campaign has attached."""
    return [
        Attachment("cell.toml", "application/toml", cell_file.read_bytes()),
        Attachment("fr3.urdf", "application/xml", fr3_urdf().encode()),
    ]


def record(bench: Bench, reference: Reference, conditions: Conditions, seed: int) -> str | None:
    """Record a demonstration. Returns None, or in one line why there is none."""
    description = _description(bench)
    specification = DemonstrationSpecification(reference.object, reference.variation, seed, reference.speed_m_s)
    metadata = {"trial": trial_metadata(specification, CELL, None)}
    with bench.archive.new(f"{RECORDINGS}/{reference.file}") as path:
        log = WholeRunLog(
            path, metadata, common_attachments(bench.cell_file),
            frames(description, reference.object),
        )  # fmt: skip
        cell = bench.open_cell(reference.object, Displacement(), seed, conditions)
        try:
            return run_demonstration(specification, description, cell, Company(log)).failure_reason
        finally:
            cell.close()


def run(bench: Bench, trial: Trial, conditions: Conditions) -> Row:
    """Run a trial and write its log. Returns the row of the results' table."""
    began_s = time.perf_counter()
    reference = Reference.named(trial.reference)
    prepared = _prepared(bench, reference)
    recording = Path(RECORDINGS) / reference.file
    specification = TrialSpecification(
        str(recording), trial.controller, trial.object, trial.displacement_mm, trial.seed,
        displacement_x_mm=trial.displacement_x_mm, yaw_deg=trial.yaw_deg,
    )  # fmt: skip
    prepared = replace(prepared, specification=specification)
    campaign = {key: str(value) for key, value in asdict(trial).items()}
    campaign |= {"id": trial.id, "digest": bench.digest}
    metadata = {"trial": trial_metadata(specification, CELL, prepared.reference), "campaign": campaign}
    with bench.archive.new(f"{LOGS}/{trial.id}.mcap") as path:
        log = WholeRunLog(
            path, metadata, common_attachments(bench.cell_file),
            frames(prepared.description, trial.object),
        )  # fmt: skip
        cell = bench.open_cell(trial.object, trial.displacement, trial.seed, conditions)
        try:
            result = run_trial(prepared, cell, Company(log), criterion=bench.criterion)
        finally:
            cell.close()
        if log.columns is None or not path.exists():
            raise OSError(result.failure_reason)
    measures = measure(
        log.columns, prepared.description, trial.object, trial.displacement_mm,
        result.nominal_impact_time_s, result.detected_impact_time_s,
    )  # fmt: skip
    return _row(trial, result, measures, git_commit(), bench.digest, time.perf_counter() - began_s)


def _row(
    trial: Trial, result: TrialResult, measures: Measures, commit: str, digest: str, wall_s: float
) -> Row:  # fmt: skip
    values = {**asdict(trial), **result.as_dict(), **asdict(measures)}
    values |= {"id": trial.id, "controller": str(trial.controller), "log": f"{LOGS}/{trial.id}.mcap"}
    return values | {
        "git_commit": commit,
        "digest": digest,
        "wall_s": wall_s,
        "worker": f"{os.uname().nodename}:{os.getpid()}",
    }
