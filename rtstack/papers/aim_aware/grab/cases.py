"""The trials that judge the grab's monitor: a plan file, and the cases that it makes."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, Positive, load_toml
from rtstack.experiments.registration import PlannedClaim, Registration
from rtstack.experiments.seeds import seed_of
from rtstack.monitor.expected import ExpectedImpact
from rtstack.papers.conditions import Conditions, Reference
from rtstack.trials.unexpected import Unexpected

Count = Annotated[int, Field(ge=1, le=10_000)]
FewOrNone = Annotated[int, Field(ge=0, le=1000)]
FIRST_PUSH_S = 0.3  # since the first motion


class FaultKind(StrEnum):
    """Faults, in the order in which they are assigned to trials."""

    MISSING = "object missing"
    SHIFTED = "shifted 60 mm"
    HEAVY = "3x the mass"
    LIGHT = "1/3 of the mass"
    TILTED = "tilted 15 deg"
    PUSH = "pushed by 40 N"
    # not in the mark, for the confusion table only
    WIDER = "40 mm wider"
    NARROWER = "40 mm narrower"
    FAR_SIDE = "one side 120 mm away"


MARKED = tuple(FaultKind)[:6]  # counted by the mark
FURTHER = tuple(FaultKind)[6:]

# what a classification that is right says
TRUE_KIND = {
    FaultKind.MISSING: Unexpected.MISSING, FaultKind.SHIFTED: Unexpected.WRONG_PLACE,
    FaultKind.HEAVY: Unexpected.TOO_HEAVY, FaultKind.LIGHT: Unexpected.TOO_LIGHT,
    FaultKind.TILTED: Unexpected.TILTED, FaultKind.PUSH: Unexpected.PUSH, FaultKind.WIDER: Unexpected.TOO_EARLY,
    FaultKind.NARROWER: Unexpected.TOO_LATE, FaultKind.FAR_SIDE: Unexpected.ONE_SIDE,
}  # fmt: skip


@checked(frozen=True, slots=True, config=STRICT)
class Faults:
    """mm, factors of the mass, degrees, N, s. wider_mm, narrower_mm: both sides; far_side_mm: one side alone."""

    shifted_mm: Positive
    heavy: Positive
    light: Positive
    tilted_deg: Positive
    push_n: Positive
    push_s: Positive
    wider_mm: Positive
    narrower_mm: Positive
    far_side_mm: Positive


@checked(frozen=True, slots=True, config=STRICT)
class JudgedSet:
    """Grabs of one object. seed: from which those of its cases follow; further: how many the mark does not count."""

    seed: Annotated[int, Field(ge=0)]
    references: tuple[Annotated[str, Field(pattern=r"^[a-z0-9_]+/\d+$")], ...]
    good: Count
    faulty: Count
    quick_references: Count
    quick_good: Count
    quick_faulty: Count
    further: FewOrNone = 0
    quick_further: FewOrNone = 0

    @property
    def object(self) -> str:
        return Reference.named(self.references[0]).object

    def recorded(self, quick: bool) -> tuple[Reference, ...]:
        return tuple(map(Reference.named, self.references[: self.quick_references] if quick else self.references))


@checked(frozen=True, slots=True, config=STRICT)
class Judged:
    """The study as its file has it. sets: one an object; the exit status follows the marks of the first one."""

    kind: Literal["aim-aware-grab"]
    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    displacement_mm: Positive
    sets: Annotated[tuple[JudgedSet, ...], Field(min_length=1)]
    faults: Faults
    conditions: Conditions
    claims: tuple[PlannedClaim, ...]
    registration: Registration | None
    quick: bool = False

    @property
    def objects(self) -> tuple[str, ...]:
        return tuple(one.object for one in self.sets)

    def size(self) -> int:
        return len(self.cases())

    def cases(self) -> list["GrabCase"]:
        """Return all cases, good and faulty in turn, so that what was run of them is a sample of both."""
        cases, quick = list[GrabCase](), self.quick
        for one in self.sets:
            good, faulty = (one.quick_good, one.quick_faulty) if quick else (one.good, one.faulty)
            further = one.quick_further if quick else one.further
            dealt = [*((k, None) for k in range(good)), *((k, MARKED[k % len(MARKED)]) for k in range(faulty))]
            dealt += [(k, FURTHER[k % len(FURTHER)]) for k in range(further)]
            cases += sorted((self._case(one, number, kind) for number, kind in dealt), key=lambda c: c.number)
        return cases

    def recorded(self) -> tuple[Reference, ...]:
        return tuple(reference for one in self.sets for reference in one.recorded(self.quick))

    def _case(self, one: JudgedSet, number: int, kind: FaultKind | None) -> "GrabCase":
        what = "good" if kind is None else "further" if kind in FURTHER else "faulty"
        seed = seed_of(one.seed, what, number)
        draw = np.random.default_rng([seed, 1])
        references = one.recorded(self.quick)
        displacement_mm = float(draw.uniform(-self.displacement_mm, self.displacement_mm))
        if kind is FaultKind.SHIFTED:
            displacement_mm = float(draw.choice([-1.0, 1.0])) * self.faults.shifted_mm
        elif kind is FaultKind.FAR_SIDE:  # what the object lacks, it lacks on one side
            displacement_mm = float(draw.choice([-1.0, 1.0])) * self.faults.far_side_mm / 2.0
        name = f"{one.object}-{what}-{number:04d}"
        return GrabCase(name, number, kind, references[number % len(references)], displacement_mm, seed)


@dataclass(frozen=True, slots=True)
class GrabCase:
    """One trial. fault: None for a good one; displacement along the world's y; seed: of plant, noise and moment."""

    id: str
    number: int
    fault: FaultKind | None
    reference: Reference
    displacement_mm: float
    seed: int

    def wider_mm(self, faults: Faults) -> float:
        """Return by how much the object is wider, along the world's y, than it should be."""
        widths = {FaultKind.WIDER: faults.wider_mm, FaultKind.NARROWER: -faults.narrower_mm}
        widths[FaultKind.FAR_SIDE] = -faults.far_side_mm
        return widths.get(self.fault, 0.0) if self.fault is not None else 0.0

    def script(self, faults: Faults, impact: ExpectedImpact) -> list[dict[str, Any]]:
        """Return the tables of a faults file, and nothing for a good trial."""
        draw = np.random.default_rng([self.seed, 2])
        side = float(draw.choice([-1.0, 1.0]))
        match self.fault:
            case FaultKind.MISSING:
                return [{"kind": "object_lost", "at_s": 0.0}]
            case FaultKind.HEAVY | FaultKind.LIGHT:
                factor = faults.heavy if self.fault is FaultKind.HEAVY else faults.light
                return [{"kind": "object_mass", "mass_factor": factor, "at_s": 0.0}]
            case FaultKind.TILTED:
                return [{"kind": "object_tilted", "tilt_deg": side * faults.tilted_deg}]
            case FaultKind.PUSH:
                direction = draw.normal(size=3)
                force = faults.push_n * direction / np.linalg.norm(direction)
                arm, at_s = str(draw.choice(["left", "right"])), float(draw.uniform(FIRST_PUSH_S, impact.set_down_s))
                push = {"kind": "push", "arm": arm, "at_s": round(at_s, 3), "duration_s": faults.push_s}
                return [push | {"force_N": force.tolist()}]
            case _:
                return []


def load_judged(path: Path, quick: bool = False) -> Judged:
    """Read the study, its sample where `quick`. Raises ConfigurationError."""
    study = load_toml(path, Judged)
    for number, one in enumerate(study.sets):
        if {reference.object for reference in one.recorded(quick=False)} != {one.object}:
            raise ConfigurationError(f"{path}: key sets.{number}.references: a set must have one object")
    if len(set(study.objects)) < len(study.objects):
        raise ConfigurationError(f"{path}: key sets: two sets have the same object")
    return replace(study, quick=quick)
