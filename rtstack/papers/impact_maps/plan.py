"""What a validation campaign consists of: a TOML file in deploy/campaigns, fixed before it is run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, ConfigurationError, NotNegative, Positive, load_toml
from rtstack.experiments.seeds import seed_of
from rtstack.papers.impact_maps.feedback import Direction
from rtstack.planning import GrabPlan, PlanError, PushPlan, grab_plan, push_plan
from rtstack.planning.free import PlanPhase
from rtstack.references.motion import Motion

Count = Annotated[int, Field(ge=1, le=1000)]

# what counts: the pushing pad along the world's -y, both pads along z (Sections VI-A and VI-B)
DIRECTIONS = {Motion.HIT_AND_PUSH: Direction((0,), 1, -1.0), Motion.GRAB: Direction((0, 1), 2, 1.0)}


class JointFriction(StrEnum):
    """What the controller compensates: what Appendix A found on this robot, joint by joint and along each reference,
    another robot's, or nothing."""

    IDENTIFIED = "identified"
    PUBLISHED = "published"
    NONE = "none"


@checked(frozen=True, slots=True, config=STRICT)
class Conditions:
    """How a trial's robot is, and what its controller knows.

    compensate_object: (26)-(27), weight, friction and inertia of the object in the feedforward. B_theta_factor: of the
    plant's reflected inertia, on what the controller and the map count on. damping_ratio: of the object on a pad, the
    scene's own where None. Frictions: the plant's; friction_scatter a fraction of both, a draw a trial.
    """

    pad_friction: Positive
    table_friction: Positive
    friction_scatter: NotNegative
    placement_mm: NotNegative
    placement_yaw_deg: NotNegative
    joint_friction: JointFriction = JointFriction.IDENTIFIED
    compensate_object: bool = True
    B_theta_factor: Positive = 1.0
    damping_ratio: Positive | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Gains:
    """Of the tasks (15)-(17), 1/s^2: position, orientation, posture; k_theta_after: orientation after the impact, where
    it is another one (VI-B)."""

    k_p: Positive
    k_theta: Positive
    k_q: Positive
    k_theta_after: Positive | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Scenario:
    """Cases by name, with the fields of PushPlan or GrabPlan that they set."""

    motion: Motion
    gains: Gains
    cases: dict[str, dict[str, float]]

    def request(self, case: str, scale: float, compensate: bool) -> GrabPlan | PushPlan:
        """Return what is to be planned. Raises PlanError for a value out of range."""
        make = grab_plan if self.motion is Motion.GRAB else push_plan
        return make(**self.cases[case], post_impact_scale=scale, compensate=compensate)


@checked(frozen=True, slots=True, config=STRICT)
class Sample:
    """What --quick takes: the first so many of each."""

    motions: tuple[Motion, ...]
    objects: Count
    cases: Count
    scales: tuple[Positive, ...]
    repetitions: Count
    identification_runs: Count = 1


@dataclass(frozen=True, slots=True)
class PlannedReference:
    """A reference that has to be planned; its file's name follows from it. along: whether its feedforward has what
    friction compensation leaves along it, (31)."""

    motion: Motion
    object: str
    case_name: str
    scale: float
    compensate: bool
    along: bool

    @property
    def file(self) -> str:
        """Name of its log."""
        kind = ("" if self.compensate else ".bare") + ("" if self.along else ".plain")
        return f"{self.motion}.{self.object}.{self.case_name}.{self.scale:g}{kind}.mcap"

    @property
    def free_runs(self) -> tuple["FreeRuns", ...]:
        """The free runs on which it depends, none where nothing is identified along it. What is before the impact is
        the same for all velocities after it."""
        if not self.along:
            return ()
        scales = {PlanPhase.ANTE: 1.0, PlanPhase.POST: self.scale}
        return tuple(FreeRuns(self.motion, self.object, self.case_name, scales[part], part) for part in PlanPhase)


@dataclass(frozen=True, slots=True)
class FreeRuns:
    """The runs of a part of a reference with nothing in the way, and what they say of it: (30)-(31)."""

    motion: Motion
    object: str
    case_name: str
    scale: float
    part: PlanPhase

    @property
    def file(self) -> str:
        """Name of the average, an array as numpy writes it."""
        return f"{self.name}.npy"

    @property
    def name(self) -> str:
        """What its files' names begin with."""
        return f"{self.motion}.{self.object}.{self.case_name}.{self.scale:g}.{self.part}"

    def log(self, run: int) -> str:
        """Name of a run's log."""
        return f"{self.name}.run{run}.mcap"


@dataclass(frozen=True, slots=True)
class ValidationTrial:
    """One trial. scale: of the reference's post-impact velocity, on the prediction; seed: of noise and placement."""

    conditions: str
    motion: Motion
    object: str
    case_name: str
    scale: float
    repetition: int
    seed: int

    @property
    def id(self) -> str:
        """A name that is a file's name too."""
        return f"{self.conditions}.{self.motion}.{self.object}.{self.case_name}.{self.scale:g}.{self.repetition}"


@checked(frozen=True, slots=True, config=STRICT)
class ValidationPlan:
    """A campaign as its file has it. robot: the seed of its arms, the same in all trials."""

    kind: Literal["impact-map-validation"]
    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    robot: Annotated[int, Field(ge=0)]
    objects: tuple[str, ...]
    scales: tuple[Positive, ...]
    repetitions: Count
    identification_runs: Count
    scenarios: tuple[Scenario, ...]
    conditions: dict[str, Conditions]
    sample: Sample | None = None
    quick: bool = False

    def size(self) -> int:
        """Number of trials."""
        return sum(1 for _ in self.trials())

    def trials(self) -> Iterator[ValidationTrial]:
        """Yield all trials. Those that differ in conditions alone share their seed."""
        for conditions in self.conditions:
            for scenario in self.scenarios:
                for thing in self.objects:
                    for case in scenario.cases:
                        for scale in self.scales:
                            for k in range(self.repetitions):
                                seed = seed_of(self.seed, scenario.motion, thing, case, scale, k)
                                yield ValidationTrial(conditions, scenario.motion, thing, case, scale, k, seed)

    def reference(self, trial: ValidationTrial) -> PlannedReference:
        """Return the reference of a trial."""
        conditions = self.conditions[trial.conditions]
        along = conditions.joint_friction is JointFriction.IDENTIFIED
        return PlannedReference(
            trial.motion, trial.object, trial.case_name, trial.scale, conditions.compensate_object, along
        )

    def references(self) -> tuple[PlannedReference, ...]:
        """Return every reference that has to be planned."""
        return tuple(dict.fromkeys(self.reference(trial) for trial in self.trials()))

    def free_runs(self) -> tuple[FreeRuns, ...]:
        """Return all runs along parts of references."""
        return tuple(dict.fromkeys(runs for reference in self.references() for runs in reference.free_runs))

    def scenario(self, motion: Motion) -> Scenario:
        """Return the scenario of a motion."""
        return next(scenario for scenario in self.scenarios if scenario.motion is motion)

    def as_sample(self, sample: Sample) -> "ValidationPlan":
        """Return the --quick version."""
        scenarios = tuple(
            replace(scenario, cases=dict(list(scenario.cases.items())[: sample.cases]))
            for scenario in self.scenarios
            if scenario.motion in sample.motions
        )
        return replace(
            self, scenarios=scenarios, objects=self.objects[: sample.objects], scales=sample.scales,
            repetitions=sample.repetitions, identification_runs=sample.identification_runs, quick=True,
        )  # fmt: skip


def load_validation_plan(path: Path, quick: bool = False) -> ValidationPlan:
    """Read and check a plan. Raises ConfigurationError with one line."""
    plan = load_toml(path, ValidationPlan)
    for scenario in plan.scenarios:
        for case in scenario.cases:
            for scale in plan.scales:
                try:
                    scenario.request(case, scale, True)
                except PlanError as error:
                    raise ConfigurationError(f"{path}: {scenario.motion}, case {case}: {error}") from None
    if quick and plan.sample is None:
        raise ConfigurationError(f"{path}: it has no quick sample: run it without --quick")
    return plan.as_sample(plan.sample) if quick and plan.sample is not None else plan
