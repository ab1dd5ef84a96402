"""The monitor's tunings, one an object, in a folder of the user's or the package's. A plan's own tuning is in its file:
runs of it deviate from what was planned, not from what was felt in a demonstration."""

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from importlib.resources import as_file, files
from pathlib import Path

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, from_document, load_toml
from hal.base.shared import user_folder
from rtstack.log.reader import read_log
from rtstack.monitor.pair import PairParameters
from rtstack.references.planned import MONITOR

JOINTS = 7


@checked(frozen=True, slots=True, config=STRICT)
class Tuning:
    """A tuning's file. provenance: from which runs, seeds and sensitivity it was made, and what it does on others."""

    monitor: PairParameters
    provenance: Mapping[str, str | int | float | list[str] | list[float] | list[int]]


def load_tuning(path: Path) -> Tuning:
    """Read a tuning made by `rtstack tune-monitor`. Raises ConfigurationError."""
    return _of_seven_joints(load_toml(path, Tuning), path)


def _of_seven_joints(tuning: Tuning, path: Path) -> Tuning:
    if tuning.monitor.arm.joints != JOINTS:
        count = tuning.monitor.arm.joints
        raise ConfigurationError(f"{path}: key monitor.arm.residual_rate_nm_s: {JOINTS} bounds, not {count}")
    return tuning


def tuning_in(plan: Path) -> Tuning | None:
    """Return the tuning that a plan was written with, None where it has none. Raises ConfigurationError, LogError."""
    attached = read_log(plan).attachment(MONITOR)
    if attached is None:
        return None
    text = attached.decode()
    return _of_seven_joints(from_document(tomllib.loads(text), Tuning, f"{plan}, {MONITOR}", text), plan)


def tuning_folder() -> Path:
    """Return the folder of the user's own tunings, an OBJECT.toml each. Raises ConfigurationError."""
    return user_folder("XDG_CONFIG_HOME", ".config") / "monitor"


def tuning_file(object_name: str) -> Path | None:
    """Return the file of an object's tuning, the user's before the installed one; None where there is none."""
    with as_file(files("deploy.monitor") / f"{object_name}.toml") as installed:
        found = [installed]
        with suppress(ConfigurationError):  # without a home
            found.insert(0, tuning_folder() / f"{object_name}.toml")
        return next((path for path in found if path.is_file()), None)


def tuning_of(object_name: str) -> Tuning | None:
    """Return the tuning of an object, None where there is none. Raises ConfigurationError."""
    path = tuning_file(object_name)
    return None if path is None else load_tuning(path)
