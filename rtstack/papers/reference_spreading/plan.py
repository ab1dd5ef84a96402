"""What a campaign consists of: a TOML file in deploy/campaigns, fixed before it is run, and the trials that follow."""

import hashlib
import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.resources import as_file, files
from itertools import product
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from rtstack.campaign.trial import Reference, Trial, seed_of, seeded
from rtstack.configuration import STRICT, ConfigurationError, load_toml
from rtstack.trials.errors import TrialError
from rtstack.trials.scoring import SuccessCriterion
from rtstack.trials.specification import Controller

GRAB_STUDY = "aim-aware-grab"  # a campaign without a plan of controllers: a study of the monitor
Count = Annotated[int, Field(ge=1, le=1000)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


@checked(frozen=True, slots=True, config=STRICT)
class Conditions:
    """The contact of a trial, and how much it differs between repetitions. Scatter: standard deviations.

    pad_stiffness N/m; friction coefficients; friction_scatter a fraction of the pads' and of the table's friction;
    tau_ext_cutoff_hz of the robot's filter of the external torque, on which the impact detector waits; speed_m_s of the
    pads at the object's surface in the demonstration, if not the variation's own.
    """

    pad_stiffness: Positive
    pad_friction: Positive
    table_friction: Positive
    friction_scatter: NotNegative
    placement_mm: NotNegative
    placement_yaw_deg: NotNegative
    tau_ext_cutoff_hz: Positive
    speed_m_s: Positive | None = None


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
    """A campaign as its file has it. digest: of everything that a result depends on but code."""

    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    controllers: tuple[Controller, ...]
    success: Success
    conditions: dict[str, Conditions]
    experiments: tuple[Experiment, ...]
    quick: bool = False
    digest: str = field(default="", kw_only=True)

    @property
    def criterion(self) -> SuccessCriterion:
        """What a success is."""
        return SuccessCriterion(self.success.lifted_m, self.success.slip_m, self.success.release_margin_s)

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

    def sealed(self, further: Sequence[bytes]) -> "Plan":
        """Return the plan with its digest; further: the other files on which a result depends."""
        sha = hashlib.sha256(json.dumps(asdict(replace(self, digest="")), sort_keys=True, default=str).encode())
        for content in further:
            sha.update(hashlib.sha256(content).digest())
        return replace(self, digest=sha.hexdigest()[:16])


@dataclass(frozen=True, slots=True)
class PlanFile:
    """Where a plan is, and which commit fixed it ("edited since" where the file is no longer what was committed)."""

    path: Path
    commit: str


def plan_names() -> list[str]:
    """Return the campaigns that have a plan."""
    return sorted(
        Path(entry.name).stem for entry in files("deploy.campaigns").iterdir() if entry.name.endswith(".toml")
    )


def plan_file(name: str) -> PlanFile:
    """Return the file of a campaign: ours by name, any by path. Raises TrialError for an unknown one."""
    if name.endswith(".toml"):
        path = Path(name).resolve()
        return PlanFile(path, _commit_of(path))
    if name not in plan_names():
        known = ", ".join(sorted([*plan_names(), GRAB_STUDY]))
        raise TrialError(f"unknown campaign {name!r}: there are {known}, or give the path of a .toml")
    with as_file(files("deploy.campaigns") / f"{name}.toml") as path:
        return PlanFile(path, _commit_of(path))


def load_plan(path: Path, quick: bool = False) -> Plan:
    """Read and check a plan. Raises ConfigurationError with one line."""
    plan = load_toml(path, Plan)
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


def _commit_of(path: Path) -> str:
    def git(*arguments: str) -> str:
        command = ["git", "-C", str(path.parent), *arguments, "--", path.name]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=5.0).stdout.strip()

    try:
        commit = git("log", "-1", "--format=%H") or "not committed"
        return commit + (", edited since" if git("status", "--porcelain") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
