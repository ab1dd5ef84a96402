"""Both studies' plan files: grids of cases, columns of the paper's tables, the portion that is run, deploy/tunings."""

import hashlib
import json
import tomllib
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from importlib.resources import as_file, files
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, Positive, Real, load_toml
from rtstack.experiments.registration import UNDIGESTED, PlannedClaim, Registration, check_claims
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.claims import JUDGES
from rtstack.papers.aim_aware.planar.parameters import Task
from rtstack.trials.specification import like


@checked(frozen=True, slots=True, config=STRICT)
class Range:
    """first, first + step, ..., last."""

    first: Real
    last: Real
    step: Positive

    def values(self) -> tuple[float, ...]:
        """Return the values, rounded to six digits."""
        count = round((self.last - self.first) / self.step) + 1
        return tuple(round(float(value), 6) for value in np.linspace(self.first, self.last, count))


@dataclass(frozen=True, slots=True)
class Case:
    """An impact: degrees, m, degrees. contact: 0 for the study's own contact, n for the n-th of its map of contacts."""

    approach_deg: float
    location_m: float
    inclination_deg: float
    repetition: int = 0
    contact: int = 0

    @property
    def id(self) -> str:
        again = f"-{self.repetition}" if self.repetition else ""
        again += f"-contact{self.contact}" if self.contact else ""
        return f"{self.approach_deg:g}deg-{self.location_m:g}m-{self.inclination_deg:+g}deg{again}"


@checked(frozen=True, slots=True, config=STRICT)
class Grid:
    """Approach angles x locations x inclinations x repetitions."""

    approach_deg: Range
    location_m: Range
    inclination_deg: Range
    repetitions: Annotated[int, Field(ge=1, le=100)] = 1

    def plans(self) -> list[tuple[float, float]]:
        """Return the planned impacts: approach angle and location."""
        return list(product(self.approach_deg.values(), self.location_m.values()))

    def cases(self) -> Iterator[Case]:
        every = product(self.plans(), self.inclination_deg.values(), range(self.repetitions))
        for (approach_deg, location_m), inclination_deg, repetition in every:
            yield Case(approach_deg, location_m, inclination_deg, repetition)

    def size(self) -> int:
        return len(self.plans()) * len(self.inclination_deg.values()) * self.repetitions


@checked(frozen=True, slots=True, config=STRICT)
class Column:
    """A column of Table 1 or 2. always_deg: always expected in its figure; ambiguity_deg: beyond it nothing is."""

    always_deg: tuple[Real, Real]
    ambiguity_deg: Positive
    window: int
    delay: int
    decay_1_s: Positive
    time_s: Positive
    horizon_s: Positive
    spacing_s: Positive
    configuration_rad: Positive
    velocity_rad_s: Positive

    def mirrored(self) -> "Column":
        """Return the same with inclinations of the other sign."""
        low, high = self.always_deg
        return replace(self, always_deg=(0.0 - high, 0.0 - low))

    def parameters(
        self, residual_rate_nm_s: tuple[float, ...], configuration_rad: float, velocity_rad_s: float
    ) -> MonitorParameters:
        """Return the monitor's tuning with these epsilon and e_m in place of the paper's."""
        own = {"configuration_rad": configuration_rad, "velocity_rad_s": velocity_rad_s}
        return like(MonitorParameters, self, residual_rate_nm_s=residual_rate_nm_s, **own)


@checked(frozen=True, slots=True, config=STRICT)
class Found:
    """epsilon rad and e_m rad/s of a tuning; separation: see tuning.py."""

    configuration_rad: Positive
    velocity_rad_s: Positive
    separation: Positive


def monitors_of(
    columns: Mapping[str, Column], found: Mapping[str, Found], residual_rate_nm_s: tuple[float, ...]
) -> dict[str, MonitorParameters]:
    """Return the tunings by name, and with the prefix paper_ those of the paper's table to the letter."""
    known: dict[str, tuple[Column, Column | Found]] = {name: (each, found[name]) for name, each in columns.items()}
    known |= {f"paper_{name}": (each, each) for name, each in columns.items()}
    return {
        name: column.parameters(residual_rate_nm_s, bounds.configuration_rad, bounds.velocity_rad_s)
        for name, (column, bounds) in known.items()
    }


@checked(frozen=True, slots=True, config=STRICT)
class Marks:
    """within_deg: resolution of inclinations, and an edge's tolerance; ambiguity_deg: the widest area, a side."""

    within_deg: Positive
    ambiguity_deg: Positive


@checked(frozen=True, slots=True, config=STRICT)
class ContactMap:
    """Contacts under which the paper's tables are run to the letter: all combinations of the values of a subclass.

    grid: the points of the map; whole: numbers, from 1, of contacts that are run at the study's other points too.
    """

    grid: Grid
    whole: tuple[int, ...]

    def each(self) -> list[dict[str, float]]:
        """Return the contacts: name -> value."""
        names = [field.name for field in fields(self) if field.name not in ("grid", "whole")]
        return [dict(zip(names, some, strict=True)) for some in product(*(getattr(self, name) for name in names))]


@checked(frozen=True, slots=True, config=STRICT)
class Outline:
    """A study: task and grids (whole, sample, and `coarse` for the tuning), contacts, marks, tunings and claims."""

    wanted_kind: ClassVar[str]
    command: ClassVar[str]  # that finds its tuning
    noisy: ClassVar[bool] = False  # True if a case is one of several random draws

    kind: str
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    title: str
    task: Task
    grid: Grid
    quick: Grid
    coarse: Grid
    contacts: ContactMap
    marks: Marks
    tunings: dict[str, Column]
    claims: tuple[PlannedClaim, ...]
    registration: Registration | None

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read and check a plan file. Raises ConfigurationError with one line."""
        outline = load_toml(path, cls)
        if outline.kind != cls.wanted_kind:
            raise ConfigurationError(f"{path}: key kind: expected {cls.wanted_kind!r}, found {outline.kind!r}")
        outline.check(path)
        return outline

    def check(self, path: Path) -> None:
        self.check_points(path, "quick")
        if any(not 1 <= number <= len(self.contacts.each()) for number in self.contacts.whole):
            raise ConfigurationError(f"{path}: key contacts.whole: give numbers from 1 to {len(self.contacts.each())}")
        check_claims(path, self.claims, JUDGES)
        for index, claim in enumerate(self.claims):
            if claim.at is not None and claim.at not in self.tunings:
                known = ", ".join(self.tunings)
                raise ConfigurationError(f"{path}: key claims.{index}.at: unknown {claim.at!r}: choose one of {known}")

    def check_points(self, path: Path, *names: str) -> None:
        """Raise ConfigurationError if a point of the named grids is not in the whole grid."""
        points = set(self.grid.cases())
        for name in names:
            strange = next((case.id for case in getattr(self, name).cases() if case not in points), None)
            if strange:
                raise ConfigurationError(f"{path}: key {name}: {strange} is not a point of the grid")


S = TypeVar("S", bound=Outline)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Portion(Generic[S, T]):
    """A study with its tuning, whole or as a sample. The claims stand apart: no row depends on them."""

    study: S
    tuned: T
    quick: bool
    claims: tuple[PlannedClaim, ...]
    registration: Registration | None

    @classmethod
    def of(cls, study: S, tuned: T, quick: bool) -> Self:
        return cls(replace(study, claims=(), registration=None), tuned, quick, study.claims, study.registration)

    @property
    def name(self) -> str:
        return self.study.name

    @property
    def title(self) -> str:
        return self.study.title

    @property
    def grid(self) -> Grid:
        """The grid that is run with the study's own contact."""
        return self.study.quick if self.quick else self.study.grid

    @property
    def contacts(self) -> list[dict[str, float]]:
        return [] if self.quick else self.study.contacts.each()

    def cases(self) -> Iterator[Case]:
        """Yield the cases of the grid, then those of each contact of the map."""
        yield from self.grid.cases()
        mapped = set(self.study.contacts.grid.cases())
        for number in range(1, len(self.contacts) + 1):
            others = self.grid.cases() if number in self.study.contacts.whole else ()
            for case in (*self.study.contacts.grid.cases(), *(case for case in others if case not in mapped)):
                yield replace(case, contact=number)

    def size(self) -> int:
        return sum(1 for _ in self.cases())

    def batch_of(self, case: Case) -> Hashable:
        """Return the key of the batch in which a case is run."""
        raise NotImplementedError


# keys of a study on which its tuning does not depend: a cell in lockstep gives what one in this process gives
NOT_TUNED_ON = (*UNDIGESTED, "marks", "contacts", "cell", "logs")


def digest_of(*paths: Path) -> str:
    """Return the digest of the values in TOML files, without claims and contacts, whatever the order of keys."""
    values = [tomllib.loads(path.read_text(encoding="utf-8")) for path in paths]
    values = [{key: value for key, value in each.items() if key not in NOT_TUNED_ON} for each in values]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def tuning_file(name: str) -> Path:
    with as_file(files("deploy.tunings") / f"{name}.toml") as path:
        return path


def tuned_for(path: Path, name: str, kind: type[T], command: str, further: Sequence[Path] = ()) -> T:
    """Return a study's tuning, if its `study_digest` is of these files. Raises ConfigurationError with the remedy."""
    tuning = tuning_file(name)
    if not tuning.exists():
        raise ConfigurationError(f"{path}: no tuning for {name} exists: find it with `{command}`")
    tuned: Any = load_toml(tuning, kind)
    if tuned.study_digest != digest_of(path, *further):
        raise ConfigurationError(f"{tuning} was found for another {path.name}: find it again with `{command}`")
    return tuned
