"""What a worker does: run a trial, write its log and return its row; or make the row of the log alone."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rtstack.cells import with_profile
from rtstack.experiments.case_log import recorded_result
from rtstack.experiments.experiment import CellRun, Row
from rtstack.log.reader import Log
from rtstack.loop.history import Columns
from rtstack.papers.conditions import LOGS, RECORDINGS, Conditions, Reference
from rtstack.papers.demonstrations import Bench, campaign_record, record_of
from rtstack.papers.reference_spreading.measures import measure
from rtstack.papers.reference_spreading.plan import Trial
from rtstack.samples import LawInertia
from rtstack.trials.review import log_columns
from rtstack.trials.specification import TrialSpecification, like
from rtstack.trials.trial import PreparedTrial, prepare_trial


@lru_cache(maxsize=4)  # the trials of a reference follow one another
def _prepared(bench: Bench, reference: Reference, law: LawInertia | None) -> PreparedTrial:
    path = bench.archive.file(f"{RECORDINGS}/{reference.file}")
    return prepare_trial(TrialSpecification(str(path), object=reference.object, law_inertia=law), bench.description)


def _of_trial(bench: Bench, trial: Trial, conditions: Conditions) -> tuple[PreparedTrial, TrialSpecification]:
    reference = Reference.named(trial.reference)
    prepared, recording = _prepared(bench, reference, conditions.law_inertia), Path(RECORDINGS) / reference.file
    chosen = {"law_inertia": conditions.law_inertia, "detector": conditions.detector}
    return prepared, like(TrialSpecification, trial, reference=str(recording), **chosen)


def on_arms(bench: Bench, trial: Trial, conditions: Conditions) -> CellRun:
    """Return a trial as a run on a cell's arms. Of the conditions, law and detector are the controller's."""
    prepared, specification = _of_trial(bench, trial, conditions)
    specification = replace(specification, reference=str(bench.out / specification.reference))
    return CellRun(
        replace(prepared, specification=specification, criterion=bench.criterion),
        bench.out / LOGS / f"{trial.id}.mcap", record_of(trial), specification.displacement,
    )  # fmt: skip


def run(bench: Bench, trial: Trial, conditions: Conditions) -> list[Row]:
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


def row_of_log(bench: Bench, trial: Trial, log: Log, columns: Mapping[str, Any]) -> Row:
    return _row(bench, trial, recorded_result(log, columns), log_columns(log))
