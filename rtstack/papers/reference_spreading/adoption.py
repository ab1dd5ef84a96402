"""The row of a trial from its log alone: of one that was run, and logged, before the program was killed."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rtstack.experiments.experiment import Row
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.papers.demonstrations import LOGS, Bench
from rtstack.papers.reference_spreading.measures import measure
from rtstack.papers.reference_spreading.trial import Trial
from rtstack.trials.review import log_columns


def adopted(bench: Bench, trials: Iterable[Trial], columns: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the rows of the trials that have a complete log of this campaign."""
    logs = bench.archive.names(LOGS)
    for trial in trials:
        name = f"{trial.id}.mcap"
        if name in logs and (row := _row_of_log(bench, bench.archive.file(f"{LOGS}/{name}"), trial, columns)):
            yield row


def _row_of_log(bench: Bench, path: Path, trial: Trial, columns: Mapping[str, Any]) -> Row | None:
    try:
        log = read_log(path)
    except LogError:
        return None
    about, metadata, recorded = (log.metadata.get(name, {}) for name in ("campaign", "trial", "result"))
    if about.get("id") != trial.id or about.get("digest") != bench.digest or not recorded:
        return None
    result = {name: _value(text, columns[name]) for name, text in recorded.items() if name in columns}
    measures = measure(
        log_columns(log), bench.description, trial.object, trial.displacement_mm,
        result["nominal_impact_time_s"], result["detected_impact_time_s"],
    )  # fmt: skip
    values = {name: getattr(trial, name) for name in trial.__slots__}
    values |= result | {name: getattr(measures, name) for name in measures.__slots__}
    values |= {"id": trial.id, "controller": str(trial.controller), "log": f"{LOGS}/{path.name}"}
    origin = {
        "git_commit": metadata.get("git_commit", "unknown"),
        "digest": bench.digest,
        "wall_s": None,
        "worker": None,
    }
    return values | origin


def _value(text: str, kind: Any) -> Any:
    return text if kind is str else _loose(text)


def _loose(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text  # a reason in words
