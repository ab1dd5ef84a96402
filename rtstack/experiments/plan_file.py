"""The file of a plan, fixed before it is run: which commit fixed it, and the digest of what results depend on."""

import hashlib
import json
import subprocess
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtstack.cells import IDEAL
from rtstack.experiments.registration import UNDIGESTED


@dataclass(frozen=True, slots=True)
class PlanFile:
    """Where a plan is, and which commit fixed it ("edited since" where the file is no longer what was committed)."""

    path: Path
    commit: str


def plan_file_at(path: Path) -> PlanFile:
    """Return the plan file at a path, which need not exist."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(path.parent), *arguments, "--", path.name]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=5.0).stdout.strip()

    try:
        commit = git("log", "-1", "--format=%H") or "not committed"
        return PlanFile(path, commit + (", edited since" if git("status", "--porcelain") else ""))
    except (OSError, subprocess.SubprocessError):
        return PlanFile(path, "unknown")


def digest_of(specification: Any, further: Iterable[Path] = (), also: object = None) -> str:
    """Return the digest (16 hexadecimal digits) of a dataclass, of files' contents, and of the repr of `also`."""
    values = asdict(specification) | {"digest": ""}  # as plans had it when they knew their digest: old folders go on
    for name in ("kind", *UNDIGESTED):
        values.pop(name, None)
    _forget_ideal(values)
    sha = hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode())
    for path in further:
        sha.update(hashlib.sha256(path.read_bytes()).digest())
    if also is not None:
        sha.update(repr(also).encode())
    return sha.hexdigest()[:16]


def _forget_ideal(values: Any) -> None:
    """Leave out the profile of an ideal robot: plans had none, and their folders go on."""
    if not isinstance(values, dict):
        return
    if values.get("profile") == IDEAL:
        del values["profile"]
    for value in values.values():
        _forget_ideal(value)
