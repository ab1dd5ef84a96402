"""The log of a case, which is the truth: a row is made of it on arms, and after a program that was killed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtstack.experiments.experiment import Case, Experiment, Row
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log.writing.job import values_of
from rtstack.trials.errors import TrialError


def case_log(path: Path, case: Case, digest: str) -> Log | None:
    """Return the log of a case, None where it is not a complete one of this case of the campaign with this digest."""
    try:
        log = read_log(path)
    except LogError:
        return None
    about = log.metadata.get("campaign", {})
    return log if (about.get("id"), about.get("digest")) == (case.id, digest) and log.metadata.get("result") else None


def row_of(experiment: Experiment[Any, Any], case: Case, path: Path) -> Row | None:
    """Return a case's row from its log, with what the engine adds; None for an incomplete one. Raises TrialError."""
    log = case_log(path, case, experiment.digest)
    if log is None:
        return None
    git_commit = log.metadata.get("trial", {}).get("git_commit", "unknown")
    origin = {"git_commit": git_commit, "digest": experiment.digest, "wall_s": None, "worker": None}
    try:
        return experiment.row_of_log(case, log) | origin
    except Exception as error:  # of a plug-in
        where = f"{type(experiment).__module__}.{type(experiment).__qualname__}"
        raise TrialError(f"{where}: row_of_log of {case.id}: {type(error).__name__}: {error}") from error


def recorded_result(log: Log, columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the log's record `result` has of these columns, name -> type."""
    known = {name: text for name, text in log.metadata["result"].items() if name in columns}
    return known | values_of({name: text for name, text in known.items() if columns[name] is not str})
