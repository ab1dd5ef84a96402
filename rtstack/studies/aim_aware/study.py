"""What the study consists of, from its file in deploy/campaigns, and the tuning that was found for it."""

import hashlib
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import as_file, files
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from rtstack.configuration import STRICT, ConfigurationError, load_toml
from rtstack.monitor.parameters import MonitorParameters
from rtstack.studies.planar.parameters import Contact, Gains, NotNegative, PlanarArm, Positive, Real, Task

STUDY = "aim_aware_planar"
COMMAND = "python -m rtstack.studies.aim_aware.tuning"


@checked(frozen=True, slots=True, config=STRICT)
class Range:
    """first, first + step, ..., last."""

    first: Real
    last: Real
    step: Positive

    def values(self) -> tuple[float, ...]:
        """Return the values, without the noise of the additions."""
        count = round((self.last - self.first) / self.step) + 1
        return tuple(round(float(value), 6) for value in np.linspace(self.first, self.last, count))


@dataclass(frozen=True, slots=True)
class Case:
    """An impact: degrees, m, degrees."""

    approach_deg: float
    location_m: float
    inclination_deg: float

    @property
    def id(self) -> str:
        """Its name."""
        return f"{self.approach_deg:g}deg-{self.location_m:g}m-{self.inclination_deg:+g}deg"


@checked(frozen=True, slots=True, config=STRICT)
class Grid:
    """Approach angles x locations x inclinations."""

    approach_deg: Range
    location_m: Range
    inclination_deg: Range

    def plans(self) -> list[tuple[float, float]]:
        """Return what is planned: approach angle and location."""
        return list(product(self.approach_deg.values(), self.location_m.values()))

    def cases(self) -> Iterator[Case]:
        """Yield all cases."""
        for approach_deg, location_m in self.plans():
            for inclination_deg in self.inclination_deg.values():
                yield Case(approach_deg, location_m, inclination_deg)

    def size(self) -> int:
        """Number of cases."""
        return len(self.plans()) * len(self.inclination_deg.values())


@checked(frozen=True, slots=True, config=STRICT)
class Column:
    """A column of Table 1, and the inclinations that Figure 7 always has as expected: |beta| <= always_deg."""

    always_deg: NotNegative
    window: int
    delay: int
    decay_1_s: Positive
    time_s: Positive
    horizon_s: Positive
    spacing_s: Positive
    configuration_rad: Positive
    velocity_rad_s: Positive

    def parameters(
        self, residual_rate_nm_s: float, configuration_rad: float, velocity_rad_s: float
    ) -> MonitorParameters:
        """Return the monitor's tuning with these epsilon and e_m in place of the paper's."""
        return MonitorParameters(
            residual_rate_nm_s=(residual_rate_nm_s,) * 3, window=self.window, delay=self.delay,
            decay_1_s=self.decay_1_s, configuration_rad=configuration_rad, time_s=self.time_s,
            horizon_s=self.horizon_s, velocity_rad_s=velocity_rad_s, spacing_s=self.spacing_s,
        )  # fmt: skip


@checked(frozen=True, slots=True, config=STRICT)
class Search:
    """What the tuning may choose from, and what it is to reach: see rtstack.studies.aim_aware.tuning."""

    residual_rate_nm_s: tuple[Positive, ...]
    ambiguity_deg: Positive


@checked(frozen=True, slots=True, config=STRICT)
class Found:
    """epsilon and e_m; separation: see tuning.py."""

    configuration_rad: Positive
    velocity_rad_s: Positive
    separation: Positive


@checked(frozen=True, slots=True, config=STRICT)
class Tuned:
    """What the tuning found for the study file of this digest. separations: of each candidate for r_b."""

    study_digest: str
    residual_rate_nm_s: Positive
    tunings: dict[str, Found]
    separations: dict[str, list[NotNegative]]


@checked(frozen=True, slots=True, config=STRICT)
class Study:
    """The study as its file has it. digest: of study and tuning, on which every result depends."""

    study: str
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    title: str
    arm: PlanarArm
    contact: Contact
    task: Task
    gains: Gains
    grid: Grid
    quick: Grid
    coarse: Grid
    tuning: Search
    tunings: dict[str, Column]

    def check(self, path: Path) -> None:
        """Raise ConfigurationError where the parts do not fit together."""
        points = set(self.grid.cases())
        for name in ("quick", "coarse"):
            strange = next((case.id for case in getattr(self, name).cases() if case not in points), None)
            if strange:
                raise ConfigurationError(f"{path}: key {name}: {strange} is no point of the grid")


@dataclass(frozen=True, slots=True)
class StudyRun:
    """A study with its tuning, and how much of it is to be run. name, quick, digest: whose results a folder has."""

    study: Study
    tuned: Tuned
    quick: bool
    digest: str
    sources: tuple[Path, ...] = field(default=())

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.study.name

    @property
    def grid(self) -> Grid:
        """What is run."""
        return self.study.quick if self.quick else self.study.grid

    def monitors(self) -> dict[str, MonitorParameters]:
        """Return the three tunings by name, and with the prefix paper_ those of Table 1 to the letter."""
        rate = self.tuned.residual_rate_nm_s
        found = self.tuned.tunings
        ours = {
            name: column.parameters(rate, found[name].configuration_rad, found[name].velocity_rad_s)
            for name, column in self.study.tunings.items()
        }
        paper = {
            f"paper_{name}": column.parameters(rate, column.configuration_rad, column.velocity_rad_s)
            for name, column in self.study.tunings.items()
        }
        return ours | paper


def digest_of(*contents: bytes) -> str:
    """Return the digest of files."""
    return hashlib.sha256(b"".join(hashlib.sha256(content).digest() for content in contents)).hexdigest()[:16]


def load_study(path: Path) -> Study:
    """Read and check a study. Raises ConfigurationError with one line."""
    study = load_toml(path, Study)
    if study.study != STUDY:
        raise ConfigurationError(f"{path}: key study: there is {STUDY!r}, not {study.study!r}")
    study.check(path)
    return study


def load_run(path: Path, quick: bool) -> StudyRun:
    """Read a study with the tuning that was found for it. Raises ConfigurationError with one line."""
    study = load_study(path)
    with as_file(files("deploy.tunings") / f"{study.name}.toml") as tuning:
        if not tuning.exists():
            raise ConfigurationError(f"{path}: there is no tuning for {study.name}: find it with `{COMMAND} {path}`")
        tuned = load_toml(tuning, Tuned)
        content = tuning.read_bytes()
    if tuned.study_digest != digest_of(path.read_bytes()):
        raise ConfigurationError(f"{tuning} was found for another {path.name}: find it again with `{COMMAND} {path}`")
    return StudyRun(study, tuned, quick, digest_of(path.read_bytes(), content), (path,))


def is_study(path: Path) -> bool:
    """Whether the file is one of a study, and not of a campaign of trials."""
    try:
        return "study" in tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False  # who reads it as a campaign says what is wrong
