"""What a worker does: run a trial and write its log. One row of plain values comes back.

Everything that trials share (cell, references, what is compiled) is kept from one to the next.
"""

from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

from rtstack.cells import with_profile
from rtstack.experiments.experiment import Row
from rtstack.log.frames import CellFrames
from rtstack.papers.conditions import Conditions
from rtstack.papers.demonstrations import CELL, LOGS, RECORDINGS, Bench, Reference, common_attachments
from rtstack.papers.reference_spreading.measures import Measures, measure
from rtstack.papers.reference_spreading.trial import Trial
from rtstack.trials.record import frames, trial_metadata
from rtstack.trials.result import TrialResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial
from rtstack.trials.whole_run_log import WholeRunLog


@lru_cache(maxsize=32)
def _prepared(bench: Bench, reference: Reference) -> PreparedTrial:
    path = bench.archive.file(f"{RECORDINGS}/{reference.file}")
    return prepare_trial(TrialSpecification(str(path), object=reference.object), bench.description)


@lru_cache(maxsize=32)
def _frames(bench: Bench, object_name: str) -> CellFrames:
    return frames(bench.description, object_name)


def run(bench: Bench, trial: Trial, conditions: Conditions) -> list[Row]:
    """Run a trial and write its log. Returns the row of the results' table."""
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
    kind = with_profile(CELL, conditions.profile)
    metadata = {"trial": trial_metadata(specification, kind, prepared.reference), "campaign": campaign}
    with bench.archive.new(f"{LOGS}/{trial.id}.mcap") as path:
        log = WholeRunLog(path, metadata, common_attachments(bench.cell_file), _frames(bench, trial.object))
        cell = bench.open_cell(trial.object, trial.displacement, trial.seed, conditions)
        try:
            result = run_trial(prepared, cell, RunContext(log), criterion=bench.criterion)
        finally:
            cell.close()
        if log.columns is None or not path.exists():
            raise OSError(result.failure_reason)
    measures = measure(
        log.columns, prepared.description, trial.object, trial.displacement_mm,
        result.nominal_impact_time_s, result.detected_impact_time_s,
    )  # fmt: skip
    return [_row(trial, result, measures)]


def _row(trial: Trial, result: TrialResult, measures: Measures) -> Row:
    values = {**asdict(trial), **result.as_dict(), **asdict(measures)}
    return values | {"id": trial.id, "controller": str(trial.controller), "log": f"{LOGS}/{trial.id}.mcap"}
