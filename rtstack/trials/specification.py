"""Specifications of runs: the one record of what is asked for, checked wherever it comes from.

The command line, HTTP, the queue, campaigns and the log's metadata use these classes. A new field of a run is written
here and nowhere else: its type states its limits, its default what an older log or program means.
"""

import re
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked
from pydantic.json_schema import SkipJsonSchema

from hal.displacement import Displacement
from rtstack.messages import MESSAGE, NUMBER, StrictBool, StrictFloat, problem
from rtstack.samples import LawInertia, Reaction
from rtstack.trials.controllers import DEFAULT, DEFAULT_DETECTOR, ControllerName, DetectorName
from rtstack.trials.errors import TrialError

MOST_SEED = 2**32 - 1  # the seeds of campaigns have 32 bits (rtstack.experiments.seeds)
MOST_SHIFT_MM, MOST_TURN_DEG = 1000.0, 180.0
SLOWEST, FASTEST = 0.1, 4.0  # speeds of a playback, times the log's own

ObjectName = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
ObjectOrNone = Annotated[str, Field(max_length=64, pattern=r"^[A-Za-z0-9_-]*$")]  # "": the cell has none
FileName = Annotated[str, Field(min_length=1, max_length=4096)]
Seed = Annotated[int, Field(ge=0, le=MOST_SEED), NUMBER]
DisplacementMm = Annotated[StrictFloat, Field(ge=-MOST_SHIFT_MM, le=MOST_SHIFT_MM)]
YawDeg = Annotated[StrictFloat, Field(ge=-MOST_TURN_DEG, le=MOST_TURN_DEG)]
Variation = Annotated[int, Field(ge=0, le=10_000), NUMBER]
Speed = Annotated[StrictFloat, Field(ge=SLOWEST, le=FASTEST)]
# names of rtstack.safety.limits.SafetyLimits, each with its value; a log has them as a table
Tightening = Annotated[
    tuple[tuple[str, Any], ...],
    BeforeValidator(lambda value: tuple(value.items()) if isinstance(value, Mapping) else value),
]
T = TypeVar("T")


def like(kind: type[T], /, *records: Any, **more: Any) -> T:
    """Return a dataclass `kind`: each field as `more` says, or as in the last record with a field of its name."""
    names = {field.name for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    values = {each.name: getattr(record, each.name) for record in records for each in fields(record)}
    return kind(**{name: value for name, value in values.items() if name in names} | more)


@checked(frozen=True, slots=True, config=MESSAGE)
class _Asked:
    """Base of all specifications. A value beyond a limit raises ValidationError. kind: the kind of run in the log.
    verb: the kind of job that the robot process carries out. needs_object: the cell is opened with `object`, which it
    must have. by_hand: a person pushes the arms; allowed in a fault. words, stem: make title and log_stem."""

    kind: ClassVar[str]
    verb: ClassVar[str]
    words: ClassVar[str] = "{0.verb}"
    stem: ClassVar[str] = "{0.verb}"
    needs_object: ClassVar[bool] = True
    by_hand: ClassVar[bool] = False

    @property
    def title(self) -> str:
        """The run in one line, for people."""
        return self.words.format(self) + ", shadow" * getattr(self, "shadow", False)

    @property
    def log_stem(self) -> str:
        """What the name of its log contains besides the time."""
        return re.sub(r"[^\w.=-]+", "_", self.stem.format(self))  # a Python object's name has other characters, too

    @property
    def practice(self) -> bool:
        """Whether its log is deleted unless it ends in a fault."""
        return False

    @property
    def displacement(self) -> Displacement:
        """The object's displacement from its nominal pose."""
        return Displacement()

    def as_job(self, number: int, operator: str, held: str) -> Self:
        """Return the specification as a job of the robot process. held: the object in the cell that is open."""
        return self

    def as_dict(self) -> dict[str, Any]:
        """Return the specification as JSON-ready values."""
        values = asdict(self).items()
        return {name: str(value) if isinstance(value, StrEnum) else value for name, value in values}


@checked(frozen=True, slots=True, config=MESSAGE)
class TrialSpecification(_Asked):
    """One trial. reference: path of a recording or plan; controller, detector (of impacts, by default Appendix B's):
    names of rtstack.trials.controllers.
    displacement_mm, displacement_x_mm, yaw_deg: shift of the object along the world's y and x, and its turn about z, in
    the plant only: the controller does not receive them. safety: limits of the judge that this trial tightens further
    (rtstack.trials.tightening). reaction: to an unexpected impact. law_inertia: mass matrix of the controller's law;
    None: the cell's. shadow: torques are computed, judged and logged on the states of the arms, and none is sent."""

    kind = verb = "trial"
    words: ClassVar[str] = "{0.controller}, {0.object}, {0.displacement.in_words}, seed {0.seed}"
    stem: ClassVar[str] = "trial-{0.controller}-{0.object}"
    reference: FileName
    controller: ControllerName = DEFAULT
    object: ObjectName = "rice_box"
    displacement_mm: DisplacementMm = 0.0
    seed: Seed = 0
    safety: SkipJsonSchema[Annotated[Tightening, Field(exclude=True)]] = ()
    reaction: Reaction = Reaction.CONTINUE
    displacement_x_mm: DisplacementMm = 0.0
    yaw_deg: YawDeg = 0.0
    law_inertia: LawInertia | None = None
    shadow: StrictBool = False
    detector: DetectorName = DEFAULT_DETECTOR

    @property
    def displacement(self) -> Displacement:
        """The object's displacement from its nominal pose."""
        return Displacement.given(self.displacement_mm, self.displacement_x_mm, self.yaw_deg)

    def as_dict(self) -> dict[str, Any]:
        """Return the specification as JSON-ready values."""
        return _Asked.as_dict(self) | {"safety": dict(self.safety)}


@checked(frozen=True, slots=True, config=MESSAGE)
class DemonstrationSpecification(_Asked):
    """One scripted demonstration. variation: a number; the variations differ like those of a person. speed_m_s: of the
    pads at the object's surface, towards it. squeeze_m: depth inside the surface at which the hands come to rest;
    squeeze_s: time from the surface to there. None: the variation's own. law_inertia: see TrialSpecification."""

    kind = verb = "demonstration"
    words: ClassVar[str] = "{0.object}, variation {0.variation}, seed {0.seed}"
    stem: ClassVar[str] = "demonstration-{0.object}"
    object: ObjectName = "rice_box"
    variation: Variation = 0
    seed: Seed = 0
    speed_m_s: StrictFloat | None = None
    squeeze_m: StrictFloat | None = None
    squeeze_s: StrictFloat | None = None
    law_inertia: LawInertia | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class PlacementSpecification(_Asked):
    """Carry an object to a place. x_mm, y_mm, yaw_deg: of the place from the object's nominal one, about the world's z.
    aim_x_mm, aim_y_mm, aim_yaw_deg: how much further the arms carry it, for what an attempt before fell short. seed: of
    a simulated cell."""

    kind: ClassVar[str] = "placement"
    verb: ClassVar[str] = "place"
    words: ClassVar[str] = "{0.object} to {0.wanted.in_words}"
    stem: ClassVar[str] = "place-{0.object}"
    object: ObjectName = "rice_box"
    x_mm: DisplacementMm = 0.0
    y_mm: DisplacementMm = 0.0
    yaw_deg: YawDeg = 0.0
    seed: Seed = 0
    aim_x_mm: DisplacementMm = 0.0
    aim_y_mm: DisplacementMm = 0.0
    aim_yaw_deg: YawDeg = 0.0

    @property
    def aimed(self) -> Displacement:
        """Where the arms set it down."""
        return Displacement.given(self.y_mm + self.aim_y_mm, self.x_mm + self.aim_x_mm, self.yaw_deg + self.aim_yaw_deg)

    @property
    def wanted(self) -> Displacement:
        """Where the object is to stand, from its nominal place."""
        return Displacement.given(self.y_mm, self.x_mm, self.yaw_deg)


@checked(frozen=True, slots=True, config=MESSAGE)
class SweepSpecification(_Asked):
    """One run of a friction identification: joint 1 to 7 of both arms moves, 0: all at once; the object is out of
    reach.
    """

    kind = verb = "identification"
    object: ObjectOrNone
    joint: Annotated[int, Field(ge=0, le=7)]
    run: Annotated[int, Field(ge=0)]
    seed: Seed = 0


@checked(frozen=True, slots=True, config=MESSAGE)
class HitSpecification(_Asked):
    """One hit of a platform by a cell's only arm. plan: name of the planned hit; inclination_deg: of the platform.
    robot: number of the simulated arm; seed: of noise and of how exactly the platform is set up."""

    kind = verb = "hit"
    needs_object: ClassVar[bool] = False
    plan: str
    inclination_deg: StrictFloat
    robot: Annotated[int, Field(ge=0)] = 0
    seed: Seed = 0
    object: ObjectOrNone = ""


@checked(frozen=True, slots=True, config=MESSAGE)
class FreeRunSpecification(_Asked):
    """One run along a part of a planned reference without an object, to measure the remaining friction. reference: its
    name; part: ante or post; seed: of the noise; robot: number of the simulated arms."""

    kind = verb = "identification"
    needs_object: ClassVar[bool] = False
    reference: FileName
    part: str
    run: Annotated[int, Field(ge=0)]
    robot: int = 0
    seed: Seed = 0
    object: ObjectOrNone = ""


@checked(frozen=True, slots=True, config=MESSAGE)
class TeleoperationSpecification(_Asked):
    """An operator moves the arms by hand. recorded: keep it as a recording; job: the number in the operator's targets.
    stop_on_release: releasing the clutch ends it."""

    verb: ClassVar[str] = "teleoperation"
    stem: ClassVar[str] = "{0.kind}-{0.object}"
    operator: str
    object: ObjectName = "rice_box"
    seed: Seed = 0
    recorded: StrictBool = False
    stop_on_release: StrictBool = True
    job: Annotated[int, NUMBER] = 0

    @property
    def kind(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]  # two kinds of run share this record
        """The kind of run in the log."""
        return "recording" if self.recorded else "teleoperation"

    @property
    def title(self) -> str:
        return f"{self.object}, {'recorded' if self.recorded else 'not recorded'}"

    @property
    def practice(self) -> bool:
        return not self.recorded

    def as_job(self, number: int, operator: str, held: str) -> Self:
        return replace(self, job=number, operator=operator)


@checked(frozen=True, slots=True, config=MESSAGE)
class PlaybackSpecification(_Asked):
    """A log played on the arms, at `speed` times its own speed. source: its path, digest: SHA-256 of that file. object:
    empty: a playback has no contact."""

    kind = verb = "playback"
    needs_object: ClassVar[bool] = False
    source: FileName
    speed: Speed = 1.0
    seed: Seed = 0
    digest: str = ""
    object: ObjectOrNone = ""

    @property
    def title(self) -> str:
        return f"{Path(self.source).name} at {self.speed:g}x"


class HandMotion(StrEnum):
    """A motion from the present configuration, ordered by an operator."""

    START = "start"  # away from the object, then home
    PUT_DOWN = "put_down"  # down until the table carries what both pads hold, then open
    OPEN = "open"  # both pads away from each other


_MOTION_TITLES = {HandMotion.START: "go to start", HandMotion.PUT_DOWN: "put it down", HandMotion.OPEN: "open"}


@checked(frozen=True, slots=True, config=MESSAGE)
class MoveSpecification(_Asked):
    """One motion from the present configuration. object: what the cell holds."""

    kind = verb = "move"
    needs_object: ClassVar[bool] = False
    motion: HandMotion
    object: ObjectOrNone = ""
    seed: Seed = 0

    @property
    def title(self) -> str:
        return _MOTION_TITLES[self.motion]

    @property
    def log_stem(self) -> str:
        return f"move-{self.motion.replace('_', '-')}"

    def as_job(self, number: int, operator: str, held: str) -> Self:
        return replace(self, object=held)


@checked(frozen=True, slots=True, config=MESSAGE)
class GuideSpecification(_Asked):
    """A person pushes the arms, in a fault too, which stays. seconds: of the robot's time at most; None: no limit."""

    kind = verb = "guide"
    words: ClassVar[str] = "by hand"
    needs_object: ClassVar[bool] = False
    by_hand: ClassVar[bool] = True
    seconds: Annotated[StrictFloat, Field(gt=0.0)] | None = None
    object: ObjectOrNone = ""
    seed: Seed = 0


Specification = (
    TrialSpecification
    | DemonstrationSpecification
    | SweepSpecification
    | FreeRunSpecification
    | HitSpecification
    | TeleoperationSpecification
    | PlaybackSpecification
    | PlacementSpecification
    | MoveSpecification
    | GuideSpecification
)
_LOGGED: dict[str, TypeAdapter[Any]] = {
    "trial": TypeAdapter(TrialSpecification),
    "demonstration": TypeAdapter(DemonstrationSpecification),
    "identification": TypeAdapter(SweepSpecification | FreeRunSpecification),
    "hit": TypeAdapter(HitSpecification),
    "teleoperation": TypeAdapter(TeleoperationSpecification),
    "recording": TypeAdapter(TeleoperationSpecification),
    "playback": TypeAdapter(PlaybackSpecification),
    "placement": TypeAdapter(PlacementSpecification),
    "move": TypeAdapter(MoveSpecification),
}


def specification_of(record: Mapping[str, str]) -> Specification:
    """Return the specification in a log's metadata record `trial`. Raises TrialError with one line. A log that names no
    law was made with M+B_theta; other missing keys have the defaults."""
    adapter = _LOGGED.get(record.get("kind", ""))
    if adapter is None:
        raise TrialError(f"the log's kind is {record.get('kind', 'unknown')}, which has no specification")
    try:
        asked = adapter.validate_json(record.get("specification", ""))
        if getattr(asked, "law_inertia", LawInertia.LINKS) is not None:
            return asked
        return replace(asked, law_inertia=record.get("law_inertia", LawInertia.LINKS_AND_MOTORS))
    except ValidationError as error:
        raise TrialError(f"the log's specification: {problem(error)}") from None
