"""Findings as they come: a line of JSON each, so that what was run stays where the program is ended."""

import fcntl
import json
import os
from dataclasses import fields
from pathlib import Path
from types import TracebackType

from rtstack.studies.grab.worker import Finding
from rtstack.trials.errors import TrialError

RESULTS = "results.jsonl"
ABOUT = "about.json"
_LEFT_BY_THE_PROGRAM = {".lock", RESULTS, ABOUT, "references", "report.html", "summary.json", "figures"}


class Results:
    """The findings in a study's folder. A context manager: one program at a time works on a folder."""

    def __init__(self, out: Path, digest: str) -> None:
        """Open or begin. Raises TrialError where another program works here."""
        self._lock = open(out / ".lock", "w", encoding="utf-8")  # noqa: SIM115 (held until the end)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise TrialError(f"another study is running in {out}: wait for it, or choose another folder") from None
        (out / ABOUT).write_text(json.dumps({"digest": digest}), encoding="utf-8")
        self._path = out / RESULTS
        self.findings = {finding.id: finding for finding in _read(self._path)}

    def __enter__(self) -> "Results":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.close()

    def add(self, finding: Finding) -> None:
        """Keep a finding."""
        self.findings[finding.id] = finding
        with open(self._path, "a", encoding="utf-8") as file:
            file.write(json.dumps(finding.as_dict()) + "\n")
            file.flush()
            os.fsync(file.fileno())


def check_folder(out: Path, digest: str, resume: bool) -> None:
    """Raise TrialError where `out` cannot be this study's folder. Nothing is written."""
    if out.exists() and not out.is_dir():
        raise TrialError(f"{out} is not a folder")
    if not out.exists() and not out.parent.is_dir():
        raise TrialError(f"cannot make {out}: the folder {out.parent} does not exist")
    if not (out / ABOUT).exists():
        if resume:
            raise TrialError(f"there is nothing to resume in {out}: leave --resume out to begin there")
        if out.is_dir() and any(entry.name not in _LEFT_BY_THE_PROGRAM for entry in out.iterdir()):
            raise TrialError(f"{out} is not empty: choose another folder")
        return
    try:
        about = json.loads((out / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TrialError(f"{out / ABOUT} cannot be read ({error}): choose another folder") from None
    if about.get("digest") != digest:
        raise TrialError(f"{out} has results of another study, or of another tuning: choose another folder")
    if not resume:
        raise TrialError(f"{out} has results of this study: go on with --resume, or choose another folder")


def _read(path: Path) -> list[Finding]:
    """Read what is there; a last line that was cut off is run again."""
    if not path.exists():
        return []
    names = {field.name for field in fields(Finding)}
    findings = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            values = json.loads(line)
        except ValueError:
            continue
        if isinstance(values, dict) and set(values) == names:
            findings.append(Finding(**values))
    return findings
