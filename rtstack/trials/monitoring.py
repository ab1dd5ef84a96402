"""The monitor's tunings, one an object, as they were committed: what is a good grab of one is none of another."""

from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path

from pydantic.dataclasses import dataclass as checked

from rtstack.configuration import STRICT, ConfigurationError, load_toml
from rtstack.monitor.pair import PairParameters

JOINTS = 7


@checked(frozen=True, slots=True, config=STRICT)
class Tuning:
    """A tuning's file. provenance: from which runs, seeds and sensitivity it was made, and what it does on others."""

    monitor: PairParameters
    provenance: Mapping[str, str | int | float | list[str] | list[float] | list[int]]


def load_tuning(path: Path) -> Tuning:
    """Read a tuning made by `rtstack tune-monitor`. Raises ConfigurationError."""
    tuning = load_toml(path, Tuning)
    if tuning.monitor.arm.joints != JOINTS:
        count = tuning.monitor.arm.joints
        raise ConfigurationError(f"{path}: key monitor.arm.residual_rate_nm_s: {JOINTS} bounds, not {count}")
    return tuning


def tuning_of(object_name: str) -> Tuning | None:
    """Return the committed tuning of an object, None where there is none. Raises ConfigurationError."""
    with as_file(files("deploy.monitor") / f"{object_name}.toml") as path:
        return load_tuning(path) if path.is_file() else None
