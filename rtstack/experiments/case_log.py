"""The log of a case, which is the truth: a row is made of it on arms, and after a program that was killed."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtstack.experiments.experiment import Case, Experiment, Row
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log


def case_log(path: Path, case: Case, digest: str) -> Log | None:
    """Return the log of a case, None where it is not a complete one of this case of the campaign with this digest."""
    try:
        log = read_log(path)
    except LogError:
        return None
    about = log.metadata.get("campaign", {})
    return log if (about.get("id"), about.get("digest")) == (case.id, digest) and log.metadata.get("result") else None


def row_of(experiment: Experiment[Any, Any], case: Case, path: Path) -> Row | None:
    """Return the row of a case from its log, with what the engine adds; None where that is not a complete one."""
    log = case_log(path, case, experiment.digest)
    if log is None:
        return None
    git_commit = log.metadata.get("trial", {}).get("git_commit", "unknown")
    origin = {"git_commit": git_commit, "digest": experiment.digest, "wall_s": None, "worker": None}
    return experiment.row_of_log(case, log) | origin


def recorded_result(log: Log, columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the log's record `result` has of these columns, name -> type."""
    recorded = log.metadata["result"]
    return {name: _value(text, columns[name]) for name, text in recorded.items() if name in columns}


def _value(text: str, kind: Any) -> Any:
    """Return a value of a log's record, where all are texts, as the column of the results has it."""
    if kind is str:
        return text
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text  # a reason in words
