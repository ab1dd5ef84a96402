"""Grids of cases, columns of the paper's tables and tunings, for both studies of the collision-monitoring paper."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, Positive, Real
from rtstack.monitor.parameters import MonitorParameters
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
