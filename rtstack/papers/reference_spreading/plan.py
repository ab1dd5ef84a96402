"""What a comparison of controllers consists of: a TOML file, fixed before it is run, and the trials that follow."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, ConfigurationError, Positive, load_toml
from rtstack.experiments.experiment import Row
from rtstack.experiments.seeds import seed_of
from rtstack.papers.conditions import Conditions
from rtstack.papers.reference import Reference
from rtstack.papers.reference_spreading.names import NAMES
from rtstack.papers.reference_spreading.trial import Trial, seeded
from rtstack.trials.controllers import ControllerName, controller_factory
from rtstack.trials.scoring import SuccessCriterion

Count = Annotated[int, Field(ge=1, le=1000)]


@checked(frozen=True, slots=True, config=STRICT)
class Selection:
    """References that prove themselves in an experiment before: the first `count` whose trials all succeeded there."""

    experiment: str
    count: Count


@checked(frozen=True, slots=True, config=STRICT)
class Sample:
    """What --quick takes of an experiment: so many of its references, and these displacements and repetitions."""

    references: Annotated[int, Field(ge=0)]
    displacements_mm: tuple[float, ...]
    repetitions: Count
    selected: Annotated[int, Field(ge=0)] = 0


@checked(frozen=True, slots=True, config=STRICT)
class Experiment:
    """References x displacements x repetitions x controllers, under each of the named conditions.

    Displacements along the world's y, and each of them with each along x and each turn about z.
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
    """A campaign as its file has it."""

    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    controllers: tuple[ControllerName, ...]
    success: Success
    conditions: dict[str, Conditions]
    experiments: tuple[Experiment, ...]
    quick: bool = False
    kind: Literal["reference-spreading"] = "reference-spreading"

    @property
    def criterion(self) -> SuccessCriterion:
        """What a success is."""
        return SuccessCriterion(self.success.lifted_m, self.success.slip_m, self.success.release_margin_s)

    def under(self, profile: str) -> "Plan":
        """Return the plan with this profile of the simulated robot under all conditions."""
        conditions = {name: replace(one, profile=profile) for name, one in self.conditions.items()}
        return replace(self, conditions=conditions)

    def size(self) -> int:
        """Number of trials."""
        return sum(self._count(experiment) for experiment in self.experiments)

    def _count(self, experiment: Experiment) -> int:
        references = len(experiment.references) + (experiment.selected.count if experiment.selected else 0)
        repetitions = experiment.repetitions * len(experiment.places) * len(experiment.conditions)
        return references * repetitions * len(self.controllers)

    def references(self) -> tuple[Reference, ...]:
        """Return every reference that has to be recorded, in the order of the file."""
        wanted = [
            replace(Reference.named(name), speed_m_s=self.conditions[conditions].speed_m_s)
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
                experiment=experiment.name,
                conditions=conditions,
                reference=replace(reference, speed_m_s=self.conditions[conditions].speed_m_s).name,
                object=reference.object,
                displacement_mm=y_mm,
                displacement_x_mm=x_mm,
                yaw_deg=yaw_deg,
                repetition=repetition,
                controller=controller,
                seed=seed_of(self.seed, experiment.name, reference.name, *seeded(y_mm, x_mm, yaw_deg), repetition),
            )
            for conditions in experiment.conditions
            for reference in references
            for y_mm, x_mm, yaw_deg in experiment.places
            for repetition in range(experiment.repetitions)
            for controller in self.controllers
        ]

    def cases(self, rows: Sequence[Row], unrecorded: Collection[str] = ()) -> list[Trial]:
        """Return the trials that are known with these results; references are selected once all candidates were run.

        unrecorded: names of references that there are not; their trials are left out.
        """
        known = [trial for each in self.experiments for trial in self.trials(each, self.chosen(each, rows, unrecorded))]
        return [trial for trial in known if trial.reference not in unrecorded]

    def chosen(
        self, experiment: Experiment, rows: Sequence[Row], unrecorded: Collection[str] = ()
    ) -> list[Reference]:  # fmt: skip
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
            if trial.reference not in unrecorded
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
            sample = experiment.quick
            if sample is None:
                continue
            selected = experiment.selected
            experiments.append(
                replace(
                    experiment,
                    references=experiment.references[: sample.references],
                    displacements_mm=sample.displacements_mm,
                    repetitions=sample.repetitions,
                    selected=replace(selected, count=sample.selected) if selected and sample.selected else None,
                )
            )
        return replace(self, experiments=tuple(experiments), quick=True)


def load_plan(path: Path, quick: bool = False) -> Plan:
    """Read and check a plan. Raises ConfigurationError, or TrialError for a controller that cannot be loaded."""
    plan = load_toml(path, Plan)
    for controller in plan.controllers:
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
