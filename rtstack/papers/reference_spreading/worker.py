"""What a worker does: run a trial and write its log. One row of plain values comes back.

Everything that trials share (cell, references, what is compiled) is kept from one to the next. Where the program was
killed between log and row, the row is made of the log alone.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rtstack.cells import with_profile
from rtstack.experiments.experiment import CellRun, Row
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.writing.job import values_of
from rtstack.loop.history import Columns
from rtstack.papers.conditions import Conditions
from rtstack.papers.demonstrations import LOGS, RECORDINGS, Bench, Reference, campaign_record
from rtstack.papers.reference_spreading.measures import measure
from rtstack.papers.reference_spreading.plan import Trial
from rtstack.samples import LawInertia
from rtstack.trials.review import log_columns
from rtstack.trials.specification import TrialSpecification, like
from rtstack.trials.trial import PreparedTrial, prepare_trial


@lru_cache(maxsize=32)
def _prepared(bench: Bench, reference: Reference, law: LawInertia | None) -> PreparedTrial:
    path = bench.archive.file(f"{RECORDINGS}/{reference.file}")
    return prepare_trial(TrialSpecification(str(path), object=reference.object, law_inertia=law), bench.description)


def _of_trial(bench: Bench, trial: Trial, conditions: Conditions) -> tuple[PreparedTrial, TrialSpecification]:
    reference = Reference.named(trial.reference)
    prepared, recording = _prepared(bench, reference, conditions.law_inertia), Path(RECORDINGS) / reference.file
    return prepared, like(TrialSpecification, trial, reference=str(recording), law_inertia=conditions.law_inertia)


def on_arms(bench: Bench, trial: Trial, conditions: Conditions) -> CellRun:
    """Return a trial as a run on a cell's arms. Of the conditions, the law's inertia is the controller's."""
    prepared, specification = _of_trial(bench, trial, conditions)
    specification = replace(specification, reference=str(bench.out / specification.reference))
    return CellRun(
        replace(prepared, specification=specification, criterion=bench.criterion),
        bench.out / LOGS / f"{trial.id}.mcap", campaign_record(trial, bench.digest), specification.displacement,
    )  # fmt: skip


def run(bench: Bench, trial: Trial, conditions: Conditions) -> list[Row]:
    """Run a trial and write its log. Returns the row of the results' table."""
    prepared, specification = _of_trial(bench, trial, conditions)
    prepared = replace(prepared, specification=specification, criterion=bench.criterion)
    with bench.archive.new(f"{LOGS}/{trial.id}.mcap") as path:
        log = bench.log(
            path, specification, prepared.parameters.inertia.law_inertia, with_profile(bench.cell, conditions.profile),
            reference=prepared.reference, campaign=campaign_record(trial, bench.digest),
        )  # fmt: skip
        built = bench.built_cell(trial.object, specification.displacement, trial.seed, conditions)
        result, columns = bench.run(prepared, built, log)
    return [_row(bench, trial, result.as_dict(), columns)]


def _row(bench: Bench, trial: Trial, result: Mapping[str, Any], columns: Columns) -> Row:
    measures = measure(
        columns, bench.description, trial.object, trial.displacement_mm,
        result["nominal_impact_time_s"], result["detected_impact_time_s"],
    )  # fmt: skip
    values = {**asdict(trial), **result, **asdict(measures)}
    return values | {"id": trial.id, "controller": str(trial.controller), "log": f"{LOGS}/{trial.id}.mcap"}


def adopted(bench: Bench, trials: Iterable[Trial], columns: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the rows of the trials that have a complete log of this campaign."""
    logs = bench.archive.names(LOGS)
    for trial in trials:
        name = f"{trial.id}.mcap"
        if name in logs and (row := row_of_log(bench, bench.archive.file(f"{LOGS}/{name}"), trial, columns)):
            yield row


def row_of_log(bench: Bench, path: Path, trial: Trial, columns: Mapping[str, Any]) -> Row | None:
    """Return a trial's row from its log at a path; None where it is not a complete one of this campaign."""
    try:
        log = read_log(path)
    except LogError:
        return None
    about, metadata, recorded = (log.metadata.get(name, {}) for name in ("campaign", "trial", "result"))
    if about.get("id") != trial.id or about.get("digest") != bench.digest or not recorded:
        return None
    known = {name: text for name, text in recorded.items() if name in columns}
    result = known | values_of({name: text for name, text in known.items() if columns[name] is not str})
    origin = {"git_commit": metadata.get("git_commit", "unknown"), "digest": bench.digest}
    return _row(bench, trial, result, log_columns(log)) | origin | {"wall_s": None, "worker": None}
