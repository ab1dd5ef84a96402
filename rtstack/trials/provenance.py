"""Where a log comes from: versions, commit and host, so that a figure can be traced to what made it."""

import os
import platform
import subprocess
import sys
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hal.base.realtime import scheduling

PACKAGES = ("rtstack", "numpy", "numba", "pin", "mujoco", "proxsuite", "daqp", "foxglove-sdk")


@lru_cache(maxsize=1)
def package_versions() -> dict[str, str]:
    """Return the versions of everything that shapes a result."""
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


@lru_cache(maxsize=1)
def git_commit() -> str:
    """Return the commit of the source tree, with "+changes" where it was edited, "unknown" outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    try:
        described = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+changes"],
            capture_output=True,
            text=True,
            check=True,
            timeout=5.0,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return described.stdout.strip()


def host_report() -> dict[str, str]:
    """Return what the host is and what this process obtained of it."""
    scheduler, priority = scheduling()
    return {
        "kernel": platform.release(),
        "machine": platform.machine(),
        "cores": str(len(os.sched_getaffinity(0))),
        "scheduler": scheduler,
        "priority": str(priority),
        "executable": Path(sys.executable).name,
    }
