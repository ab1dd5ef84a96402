"""What a validation campaign consists of: a TOML file in deploy/campaigns, fixed before it is run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Positive, load_toml
from rtstack.experiments.cell.schedule import CellSchedule
from rtstack.experiments.registration import PlannedClaim, Registration, check_claims
from rtstack.experiments.seeds import seed_of
from rtstack.impact_map import MapKind
from rtstack.papers.impact_maps.claims import JUDGES
from rtstack.papers.impact_maps.feedback import Direction
from rtstack.planning import GrabPlan, PlanError, PushPlan, checked_plan
from rtstack.planning.free import PlanPhase
from rtstack.references.motion import Motion
from rtstack.trials.errors import TrialError

SWEEPS = "identification"  # the folder of what was identified
Count = Annotated[int, Field(ge=1, le=1000)]

# what counts: the pushing pad along the world's -y, both pads along z (Sections VI-A and VI-B)
DIRECTIONS = {Motion.HIT_AND_PUSH: Direction((0,), 1, -1.0), Motion.GRAB: Direction((0, 1), 2, 1.0)}


class JointFriction(StrEnum):
    """What the controller compensates: what Appendix A found on this robot and along each reference, another's,
    nothing."""

    IDENTIFIED = "identified"
    PUBLISHED = "published"
    NONE = "none"


@checked(frozen=True, slots=True, config=STRICT)
class ValidationConditions:
    """How a trial's robot is, and what its controller knows. Frictions: the plant's, friction_scatter a fraction of
    both.

    compensate_object: (26)-(27). B_theta_factor: the plant's reflected inertia over what controller and map count on.
    damping_ratio: of the object on a pad. motor_inertia_scatter: of B and B_theta of each joint, a fraction; None: the
    scene's, the plant's own. map: which one the references follow after the impact. motions: the scenarios.
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
    motor_inertia_scatter: NotNegative | None = None
    map: MapKind = MapKind.CONVERGED
    motions: tuple[Motion, ...] = tuple(Motion)


@checked(frozen=True, slots=True, config=STRICT)
class Gains:
    """Of the tasks (15)-(17), 1/s^2: position, orientation, posture; k_theta_after: after the impact (VI-B)."""

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

    def request(
        self, case: str, scale: float = 1.0, compensate: bool = True, kind: MapKind = MapKind.CONVERGED
    ) -> GrabPlan | PushPlan:
        """Return what is to be planned. Raises PlanError for a value out of range."""
        plan = GrabPlan if self.motion is Motion.GRAB else PushPlan
        return checked_plan(plan, **self.cases[case], post_impact_scale=scale, compensate=compensate, map=kind)


@checked(frozen=True, slots=True, config=STRICT)
class Sample:
    """What --quick takes: the first so many of each."""

    motions: tuple[Motion, ...]
    objects: Count
    cases: Count
    scales: tuple[Positive, ...]
    repetitions: Count
    identification_runs: Count = 1
    robots: Count = 1


@dataclass(frozen=True, slots=True)
class PlannedReference:
    """A reference that has to be planned. along: with what friction compensation leaves along it, (31)."""

    robot: int
    motion: Motion
    object: str
    case_name: str
    scale: float
    compensate: bool
    along: bool
    map: MapKind

    @property
    def file(self) -> str:
        kind = ("" if self.compensate else ".bare") + ("" if self.along else ".plain") + _suffix(self.map)
        return f"{self.motion}.{self.object}.{self.case_name}.{self.scale:g}{kind}.r{self.robot}.mcap"

    @property
    def free_runs(self) -> tuple["FreeRuns", ...]:
        """The free runs on which it depends; before the impact they are the same for all velocities after it."""
        if not self.along:
            return ()
        parts = {PlanPhase.ANTE: (1.0, MapKind.CONVERGED), PlanPhase.POST: (self.scale, self.map)}
        return tuple(
            FreeRuns(self.robot, self.motion, self.object, self.case_name, scale, part, kind)
            for part, (scale, kind) in parts.items()
        )


@dataclass(frozen=True, slots=True)
class Setting:
    """What a trial follows, and the gains and conditions under which it does."""

    reference: PlannedReference
    gains: Gains
    conditions: ValidationConditions


@dataclass(frozen=True, slots=True)
class FreeRuns:
    """The runs of a robot along a part of a reference with nothing in the way, and what they say of it: (30)-(31)."""

    robot: int
    motion: Motion
    object: str
    case_name: str
    scale: float
    part: PlanPhase
    map: MapKind

    @property
    def file(self) -> str:
        return f"{self.name}.npy"

    @property
    def name(self) -> str:
        return (
            f"{self.motion}.{self.object}.{self.case_name}.{self.scale:g}.{self.part}{_suffix(self.map)}.r{self.robot}"
        )

    def log(self, run: int) -> str:
        return f"{self.name}.run{run}.mcap"


@dataclass(frozen=True, slots=True)
class ValidationTrial:
    """scale: of the post-impact velocity, on the prediction; seed: of noise and placement; robot: seed of the arms."""

    conditions: str
    motion: Motion
    object: str
    case_name: str
    scale: float
    repetition: int
    seed: int
    robot: int

    @property
    def id(self) -> str:
        return f"{self.conditions}.{self.motion}.{self.object}.{self.case_name}.{self.scale:g}.{self.repetition}"


@checked(frozen=True, slots=True, config=STRICT)
class ValidationPlan:
    """A campaign as its file has it. robots: seeds of the arms; a repetition is of the robot whose turn it is."""

    kind: Literal["impact-map-validation"]
    name: str
    title: str
    seed: Annotated[int, Field(ge=0)]
    robots: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]
    objects: tuple[str, ...]
    scales: tuple[Positive, ...]
    repetitions: Count
    identification_runs: Count
    scenarios: tuple[Scenario, ...]
    conditions: dict[str, ValidationConditions]
    sample: Sample | None = None
    quick: bool = False
    on_cell: CellSchedule | None = None
    claims: tuple[PlannedClaim, ...] = ()
    registration: Registration | None = None

    def size(self) -> int:
        return sum(1 for _ in self.trials())

    def trials(self) -> Iterator[ValidationTrial]:
        """Yield all trials. Those that differ in conditions alone share their seed."""
        for conditions, about in self.conditions.items():
            for scenario in (one for one in self.scenarios if one.motion in about.motions):
                every = product(self.objects, scenario.cases, self.scales, range(self.repetitions))
                for thing, case, scale, k in every:
                    seed = seed_of(self.seed, scenario.motion, thing, case, scale, k)
                    robot = self.robots[k % len(self.robots)]
                    yield ValidationTrial(conditions, scenario.motion, thing, case, scale, k, seed, robot)

    def reference(self, trial: ValidationTrial) -> PlannedReference:
        conditions = self.conditions[trial.conditions]
        along = conditions.joint_friction is JointFriction.IDENTIFIED
        return PlannedReference(
            trial.robot, trial.motion, trial.object, trial.case_name, trial.scale, conditions.compensate_object, along,
            conditions.map,
        )  # fmt: skip

    def setting(self, trial: ValidationTrial) -> Setting:
        return Setting(self.reference(trial), self.scenario(trial.motion).gains, self.conditions[trial.conditions])

    def references(self) -> tuple[PlannedReference, ...]:
        return tuple(dict.fromkeys(self.reference(trial) for trial in self.trials()))

    def free_runs(self) -> tuple[FreeRuns, ...]:
        return tuple(dict.fromkeys(runs for reference in self.references() for runs in reference.free_runs))

    def scenario(self, motion: Motion) -> Scenario:
        return next(scenario for scenario in self.scenarios if scenario.motion is motion)

    def on_arms(self) -> "ValidationPlan":
        """Return the plan for arms, which are one robot. Raises TrialError where conditions differ in the plant."""
        plants = {
            replace(each, joint_friction=JointFriction.NONE, compensate_object=True, map=MapKind.CONVERGED, motions=())
            for each in self.conditions.values()
        }
        if len(plants) > 1:
            raise TrialError(
                f"{self.name} compares conditions that arms cannot be given, such as pad_friction: on arms give a plan "
                "whose conditions differ in joint_friction, compensate_object, map or motions"
            )
        return replace(self, robots=self.robots[:1])

    def as_sample(self, sample: Sample) -> "ValidationPlan":
        """Return the --quick version."""
        scenarios = tuple(
            replace(scenario, cases=dict(list(scenario.cases.items())[: sample.cases]))
            for scenario in self.scenarios
            if scenario.motion in sample.motions
        )
        return replace(
            self, scenarios=scenarios, objects=self.objects[: sample.objects], scales=sample.scales,
            repetitions=sample.repetitions, robots=self.robots[: sample.robots],
            identification_runs=sample.identification_runs, quick=True,
        )  # fmt: skip


def _suffix(kind: MapKind) -> str:
    return "" if kind is MapKind.CONVERGED else f".{kind}"


def load_validation_plan(path: Path, quick: bool = False) -> ValidationPlan:
    """Read and check a plan. Raises ConfigurationError with one line."""
    plan = load_toml(path, ValidationPlan)
    check_claims(path, plan.claims, JUDGES)
    for scenario in plan.scenarios:
        for case, scale in product(scenario.cases, plan.scales):
            try:
                scenario.request(case, scale)
            except PlanError as error:
                raise ConfigurationError(f"{path}: {scenario.motion}, case {case}: {error}") from None
    if quick and plan.sample is None:
        raise ConfigurationError(f"{path}: it has no quick sample: run it without --quick")
    return plan.as_sample(plan.sample) if quick and plan.sample is not None else plan
