"""Which version of judge and arming state machine a result belongs to."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
PACKAGE = SUPPORT.parents[2] / "rtstack" / "safety"
MODULES = ("stop", "checks", "judge", "geometry", "limits", "records", "body", "reasons", "arming")


def digest(*more: Path, modules: Iterable[str] = MODULES) -> str:
    """Return what tells one version of these modules of the package, and of more files, from another."""
    files = [*(PACKAGE / f"{module}.py" for module in modules), *more]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]
