"""What the files of the collision-monitoring paper's studies have in common, and how much of a study is run."""

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Generic, TypeVar

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, ConfigurationError, load_toml
from rtstack.papers.aim_aware.grid import Case, Grid
from rtstack.papers.aim_aware.planar.parameters import Task


@checked(frozen=True, slots=True, config=STRICT)
class Outline:
    """Its task, and its grids: all of it, a sample, and what the tuning sees (`coarse`)."""

    kind: str
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    title: str
    task: Task
    grid: Grid
    quick: Grid
    coarse: Grid

    def check(self, path: Path) -> None:
        """Raise ConfigurationError where the parts do not fit together."""
        self.check_points(path, "quick")

    def check_points(self, path: Path, *names: str) -> None:
        """Raise ConfigurationError where a point of the grids of these names is none of the whole one."""
        points = set(self.grid.cases())
        for name in names:
            strange = next((case.id for case in getattr(self, name).cases() if case not in points), None)
            if strange:
                raise ConfigurationError(f"{path}: key {name}: {strange} is no point of the grid")


S = TypeVar("S", bound=Outline)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Portion(Generic[S, T]):
    """A study with its tuning, and how much of it is to be run."""

    study: S
    tuned: T
    quick: bool

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.study.name

    @property
    def title(self) -> str:
        """Title of its page."""
        return self.study.title

    @property
    def grid(self) -> Grid:
        """What is run."""
        return self.study.quick if self.quick else self.study.grid

    def size(self) -> int:
        """Number of cases."""
        return self.grid.size()

    def batch_of(self, case: Case) -> Hashable:
        """Return what a case shares with those that are run with it."""
        raise NotImplementedError


def load_outline(path: Path, kind: type[S], name: str) -> S:
    """Read and check the file of the study `name`. Raises ConfigurationError with one line."""
    study = load_toml(path, kind)
    if study.kind != name:
        raise ConfigurationError(f"{path}: key kind: there is {name!r}, not {study.kind!r}")
    study.check(path)
    return study
