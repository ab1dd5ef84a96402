"""What a comparison of controllers consists of: a TOML file, fixed before it is run, and the trials that follow."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, Positive, load_toml
from rtstack.experiments.cell.schedule import CellSchedule
from rtstack.experiments.experiment import Row
from rtstack.experiments.registration import PlannedClaim, Registration, check_claims
from rtstack.experiments.seeds import seed_of
from rtstack.papers.conditions import Conditions, Hand, Reference
from rtstack.papers.reference_spreading.claims import JUDGES
from rtstack.papers.reference_spreading.controllers import NAMES
from rtstack.samples import LawInertia
from rtstack.trials.controllers import ControllerName, controller_factory
from rtstack.trials.scoring import SuccessCriterion

HANDS = "hands"  # what an experiment names for all of them
Values = Annotated[tuple[Positive, ...], Field(min_length=1)]


@checked(frozen=True, slots=True, config=STRICT)
class Hands:
    """Every combination of these, all else as in the conditions `base`. Depth m and time s: see conditions.Hand; of an
    even stop the time is 0. pad_stiffness N/m.
    """

    base: str
    law_inertia: Annotated[tuple[LawInertia, ...], Field(min_length=1)]
    pad_stiffness: Values
    depth_m: Values
    stop_s: Annotated[tuple[Annotated[float, Field(ge=0.0, le=1.0)], ...], Field(min_length=1)]

    def conditions(self, base: Conditions) -> dict[str, Conditions]:
        """Return the conditions of each combination by name."""
        return {
            combination_name(*each): replace(
                base, law_inertia=each[0], pad_stiffness=each[1], hand=Hand(depth_m=each[2], stop_s=each[3] or None)
            )
            for each in product(self.law_inertia, self.pad_stiffness, self.depth_m, self.stop_s)
        }


def combination_name(law: LawInertia, pad_n_m: float, depth_m: float, stop_s: float) -> str:
    """Return the name of a combination's conditions, a part of a file's name too."""
    return f"{law}_{1e-3 * pad_n_m:g}kNm_{1e3 * depth_m:g}mm_" + (f"{1e3 * stop_s:g}ms" if stop_s else "even")


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial. reference: its name; displacement along the world's y and x, and about z; seed: of plant, noise and
    placement.
    """

    experiment: str
    conditions: str
    reference: str
    object: str
    displacement_mm: float
    repetition: int
    controller: str
    seed: int
    displacement_x_mm: float = 0.0
    yaw_deg: float = 0.0

    @property
    def id(self) -> str:
        """A name that is a file's name too, and says everything but the seed, which follows from it."""
        x, yaw = self.displacement_x_mm, self.yaw_deg
        shift = f"{self.displacement_mm:+g}mm" + f"{x:+g}mmx" * (x != 0.0) + f"{yaw:+g}deg" * (yaw != 0.0)
        place = f"{self.reference.replace('/', '-')}.{shift}.{self.repetition}"
        return f"{self.experiment}.{self.conditions}.{place}.{self.controller}"


def seeded(y_mm: float, x_mm: float, yaw_deg: float) -> tuple[float, ...]:
    """Return what of a place a seed depends on: along y alone where there is no more, as it was before there was."""
    return (y_mm,) if x_mm == yaw_deg == 0.0 else (y_mm, x_mm, yaw_deg)


Count = Annotated[int, Field(ge=1, le=1000)]


@checked(frozen=True, slots=True, config=STRICT)
class Selection:
    """References that prove themselves in an experiment before: the first `count` whose trials all succeeded there."""

    experiment: str
    count: Count


@checked(frozen=True, slots=True, config=STRICT)
class Sample:
    """What --quick takes of an experiment: so many of its references and conditions, these displacements and
    repetitions.
    """

    references: Annotated[int, Field(ge=0)]
    displacements_mm: tuple[float, ...]
    repetitions: Count
    selected: Annotated[int, Field(ge=0)] = 0
    conditions: Count = 1


@checked(frozen=True, slots=True, config=STRICT)
class Experiment:
    """References x displacements x repetitions x controllers, under each of the named conditions.

    Displacements along the world's y, and each of them with each along x and each turn about z. controllers: by default
    those of the plan. conditions: of the plan; a reference is recorded under each of them.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    references: tuple[Annotated[str, Field(pattern=r"^[a-z0-9_]+/\d+$")], ...]
    displacements_mm: tuple[float, ...]
    repetitions: Count
    quick: Sample | None = None
    selected: Selection | None = None
    conditions: tuple[str, ...] = ("nominal",)
    displacements_x_mm: Annotated[tuple[float, ...], Field(min_length=1)] = (0.0,)
    yaws_deg: Annotated[tuple[float, ...], Field(min_length=1)] = (0.0,)
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1)] | None = None

    @property
    def places(self) -> list[tuple[float, float, float]]:
        """Where the object is put: mm along y and x, degrees about z."""
        return list(product(self.displacements_mm, self.displacements_x_mm, self.yaws_deg))


@checked(frozen=True, slots=True, config=STRICT)
class Success:
    """When a grab counts: see rtstack.trials.scoring.SuccessCriterion."""

    lifted_m: Positive
    slip_m: Positive
    release_margin_s: Positive


@checked(frozen=True, slots=True, config=STRICT)
class Plan:
    """A campaign as its file has it. claims: about the first conditions, and about each of the others beside them.

    hands: conditions of their own for each combination, in whose place an experiment names `hands`. cell_file: beside
    the plan's file, where the cell is not the default one; `--cell-file` comes before it.
    """

    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    controllers: tuple[ControllerName, ...]
    success: Success
    conditions: dict[str, Conditions]
    experiments: tuple[Experiment, ...]
    quick: bool = False
    kind: Literal["reference-spreading"] = "reference-spreading"
    hands: Hands | None = None
    cell_file: str | None = None
    claims: tuple[PlannedClaim, ...] = ()
    registration: Registration | None = None
    on_cell: CellSchedule | None = None

    @property
    def criterion(self) -> SuccessCriterion:
        """What a success is."""
        return SuccessCriterion(self.success.lifted_m, self.success.slip_m, self.success.release_margin_s)

    def under(self, profile: str) -> "Plan":
        """Return the plan with this profile of the simulated robot under all conditions."""
        return replace(self, conditions={name: replace(one, profile=profile) for name, one in self.conditions.items()})

    def size(self) -> int:
        """Number of trials."""
        return sum(self._count(experiment) for experiment in self.experiments)

    def _count(self, experiment: Experiment) -> int:
        references = len(experiment.references) + (experiment.selected.count if experiment.selected else 0)
        repetitions = experiment.repetitions * len(experiment.places) * len(experiment.conditions)
        return references * repetitions * len(self.controllers_of(experiment))

    def controllers_of(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the names of the controllers that an experiment compares."""
        return experiment.controllers or self.controllers

    def recorded(self, reference: Reference, conditions: str) -> Reference:
        """Return the reference as it is recorded under these conditions: those of the first ones have no mark."""
        return replace(reference, conditions="" if conditions == next(iter(self.conditions)) else conditions)

    def conditions_of(self, reference: Reference) -> Conditions:
        """Return the conditions under which a reference is recorded."""
        return self.conditions[reference.conditions or next(iter(self.conditions))]

    def references(self) -> tuple[Reference, ...]:
        """Return every reference that has to be recorded, in the order of the file."""
        wanted = [
            self.recorded(Reference.named(name), conditions)
            for experiment in self.experiments
            for conditions in experiment.conditions
            for name in experiment.references
        ]
        return tuple(dict.fromkeys(wanted))

    def trials(self, experiment: Experiment, chosen: Sequence[Reference] = ()) -> list[Trial]:
        """Return the trials of an experiment; chosen: the references that were selected for it.

        The controllers of a repetition share its seed: they meet the same arms, friction and placement.
        """
        references = [*chosen, *map(Reference.named, experiment.references)]
        return [
            Trial(
                experiment.name, conditions, self.recorded(reference, conditions).name, reference.object, y_mm,
                repetition, controller, displacement_x_mm=x_mm, yaw_deg=yaw_deg,
                seed=seed_of(self.seed, experiment.name, reference.name, *seeded(y_mm, x_mm, yaw_deg), repetition),
            )
            for conditions in experiment.conditions
            for reference in references
            for y_mm, x_mm, yaw_deg in experiment.places
            for repetition in range(experiment.repetitions)
            for controller in self.controllers_of(experiment)
        ]  # fmt: skip

    def cases(self, rows: Sequence[Row], unrecorded: Collection[str] = ()) -> list[Trial]:
        """Return the trials that are known with these results; references are selected once all candidates were run.

        unrecorded: names of references that there are not; their trials are left out.
        """
        known = [trial for each in self.experiments for trial in self.trials(each, self.chosen(each, rows, unrecorded))]
        return [trial for trial in known if trial.reference not in unrecorded]

    def chosen(self, experiment: Experiment, rows: Sequence[Row], unrecorded: Collection[str] = ()) -> list[Reference]:
        """Return the references selected for an experiment: those that succeeded most often in the one before.

        None as long as that one has trials without a result. The paper's controllers count, all where none of them
        runs.
        """
        selection = experiment.selected
        if selection is None:
            return []
        before = {
            trial.id
            for each in self.experiments
            if each.name == selection.experiment
            for trial in self.trials(each)
            if trial.reference not in unrecorded and trial.conditions in experiment.conditions
        }
        kept = [row for row in rows if row["id"] in before]
        if len(kept) < len(before):
            return []
        papers = [row for row in kept if row["controller"] in NAMES]
        return select(papers or kept, selection.count)

    def as_sample(self) -> "Plan":
        """Return the --quick version. Experiments without one are left out."""
        experiments = []
        for experiment in self.experiments:
            if (sample := experiment.quick) is None:
                continue
            selected = experiment.selected
            experiments.append(replace(
                experiment, references=experiment.references[: sample.references],
                displacements_mm=sample.displacements_mm, repetitions=sample.repetitions,
                selected=replace(selected, count=sample.selected) if selected and sample.selected else None,
                conditions=experiment.conditions[: sample.conditions],
            ))  # fmt: skip
        return replace(self, experiments=tuple(experiments), quick=True)


def load_plan(path: Path, quick: bool = False) -> Plan:
    """Read and check a plan. Raises ConfigurationError, or TrialError for a controller that cannot be loaded."""
    plan = load_toml(path, Plan)
    check_claims(path, plan.claims, JUDGES)
    if (hands := plan.hands) is not None:
        if hands.base not in plan.conditions:
            raise ConfigurationError(f"{path}: key hands.base: no conditions are named {hands.base}")
        made = hands.conditions(plan.conditions[hands.base])
        experiments = (replace(each, conditions=tuple(made)) if each.conditions == (HANDS,) else each
                       for each in plan.experiments)  # fmt: skip
        plan = replace(plan, conditions=plan.conditions | made, experiments=tuple(experiments))
    for controller in {*plan.controllers, *(name for each in plan.experiments for name in each.controllers or ())}:
        controller_factory(controller)
    names = [experiment.name for experiment in plan.experiments]
    for index, experiment in enumerate(plan.experiments):
        unknown = [name for name in experiment.conditions if name not in plan.conditions]
        if unknown:
            raise ConfigurationError(f"{path}: experiment {experiment.name}: no conditions are named {unknown[0]}")
        if experiment.selected and experiment.selected.experiment not in names[:index]:
            raise ConfigurationError(
                f"{path}: experiment {experiment.name} selects from an experiment that is not before"
            )
    if quick and not any(experiment.quick for experiment in plan.experiments):
        raise ConfigurationError(f"{path}: no experiment has a quick sample: run it without --quick")
    return plan.as_sample() if quick else plan


def select(rows: Sequence[Row], count: int) -> list[Reference]:
    """Return the `count` references with the most successes, each kind in the order in which they come."""
    successes: dict[str, int] = {}
    for row in rows:
        successes[row["reference"]] = successes.get(row["reference"], 0) + bool(row["success"])
    best = sorted(successes, key=lambda name: -successes[name])[:count]
    return [Reference.named(name) for name in successes if name in best]
