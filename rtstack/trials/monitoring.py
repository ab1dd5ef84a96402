"""The monitor of a trial: its tuning, as it was committed, and what became of the impact."""

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


def load_tuning(path: Path | None = None) -> Tuning:
    """Read a tuning made by `rtstack tune-monitor`, the committed one by default. Raises ConfigurationError."""
    if path is None:
        with as_file(files("deploy.monitor") / "grab.toml") as default:
            return load_tuning(default)
    tuning = load_toml(path, Tuning)
    if tuning.monitor.arm.joints != JOINTS:
        count = tuning.monitor.arm.joints
        raise ConfigurationError(f"{path}: key monitor.arm.residual_rate_nm_s: {JOINTS} bounds, not {count}")
    return tuning
