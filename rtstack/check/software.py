"""Whether the packages are the ones that rtstack asks for, and the ones that it was tested with; and room for logs."""

import platform
import shutil
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.resources import files
from pathlib import Path

from packaging.requirements import Requirement

from hal.base.extras import published_for
from hal.base.shared import left_behind
from rtstack.check.finding import Finding, finding

_LOG_BYTES = 1e6  # a second of a log, and a trial has some ten of them
_ENOUGH_BYTES = 10e9
_LEAST_BYTES = 1e9
_SHARED_BYTES = 64e6  # rings and mailbox of a stack, with room
_IMPORTANT = ("mujoco", "pin", "proxsuite", "pylibfranka", "numba", "numpy")  # a result may depend on these


def software_findings(logs: Path) -> list[Finding]:
    """Look at Python, packages, the folder of logs, shared memory, and what killed processes left there."""
    missing, found = ", ".join(_unmet()), left_behind()
    left = ", ".join(f"{path} of {owner}" for path, owner in found.items()) or "nothing"
    try:
        shared = shutil.disk_usage("/dev/shm").free
    except OSError:
        shared = 0
    return [
        finding(
            "Python", platform.python_version(), sys.version_info >= (3, 11), "nothing starts",
            "install Python 3.11 or newer", required=True,
        ),
        finding(
            "packages", missing or "all there", not missing, "what needs them fails when it is used",
            "`pip install --constraint constraints.txt 'rtstack[all]'`", required=True,
        ),
        *(_tested(name) for name in _IMPORTANT),
        _disk(logs),
        finding(
            "shared memory", f"{shared / 1e6:.0f} MB", shared > _SHARED_BYTES, "loop, log and console cannot meet",
            "mount a tmpfs of 256 MB at /dev/shm (a container: --shm-size=256m)", required=True,
        ),
        finding(
            "left behind", left, not found, "memory, and disk, of processes that were killed",
            "yours go when `rtstack up` or `trial` starts again, others when their user does that",
        ),
    ]  # fmt: skip


def _unmet() -> Iterator[str]:
    for line in requires("rtstack") or ():
        wanted = Requirement(line)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            try:
                found = version(wanted.name)
            except PackageNotFoundError:
                yield f"{wanted.name} is missing"
                continue
            if not wanted.specifier.contains(found, prereleases=True):
                yield f"{wanted.name} {found} is not {wanted.specifier}"


def _tested(name: str) -> Finding:
    tested = versions_tested().get(name, "")
    try:
        now = version(name)
    except PackageNotFoundError:
        now = "missing"
        if pythons := published_for(name):
            return Finding(name, now, "warn", f"install rtstack into a Python for which there is one ({pythons})",
                           "no real arms, and no cells behind their protocol")  # fmt: skip
    return finding(name, now, now == tested, f"tested with {tested}: results may differ",
                   f"`pip install {name}=={tested}`")  # fmt: skip


def versions_tested() -> dict[str, str]:
    """Return the version of each package that the tests ran with, by its name in small letters."""
    lines = files("deploy").joinpath("constraints.txt").read_text().splitlines()
    pairs = (line.partition("==") for line in lines if "==" in line)
    return {name.strip().lower(): number.strip() for name, _, number in pairs}


def _disk(logs: Path) -> Finding:
    there = next(path for path in (logs.resolve(), *logs.resolve().parents) if path.exists())
    if not there.is_dir():
        cost, advice = "no arm moves without a log", "another folder with --logs"
        return finding("disk", f"{there} is no folder", False, cost, advice, required=True)
    free = shutil.disk_usage(there).free
    value = f"{free / 1e9:.0f} GB at {there}, {free / _LOG_BYTES / 3600:.0f} h of logs"
    advice = "another folder with --logs, or `rtstack logs prune`"
    cost, required = "a full disk stops the arms", free < _LEAST_BYTES
    return finding("disk", value, free > _ENOUGH_BYTES, cost, advice, required=required)
