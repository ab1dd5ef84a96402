"""What a trial is asked to do: data, and nothing else."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, ClassVar

from hal.displacement import Displacement
from rtstack.samples import Reaction
from rtstack.trials.controllers import DEFAULT

# names of rtstack.safety.limits.SafetyLimits, each with its value
Tightening = tuple[tuple[str, Any], ...]


@dataclass(frozen=True, slots=True)
class _Asked:
    """What a run is asked to do. The `kind` of each is what its log says."""

    def as_dict(self) -> dict[str, Any]:
        """Return the specification as JSON-ready values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class TrialSpecification(_Asked):
    """One trial. reference: the path of a recording; controller: a name of rtstack.trials.controllers.

    displacement_mm: the object's shift along the world's y. The shift along x and the turn about z are the plant's too:
    no controller learns of any of them. safety: the judge's limits that this trial tightens besides the cell's
    (rtstack.trials.tightening). reaction: to an impact that was not meant.
    """

    kind: ClassVar[str] = "trial"
    reference: str
    controller: str = DEFAULT
    object: str = "rice_box"
    displacement_mm: float = 0.0
    seed: int = 0
    safety: Tightening = ()
    reaction: Reaction = Reaction.CONTINUE
    displacement_x_mm: float = 0.0
    yaw_deg: float = 0.0

    @property
    def displacement(self) -> Displacement:
        """Where the object is put."""
        return Displacement.given(self.displacement_mm, self.displacement_x_mm, self.yaw_deg)

    def as_dict(self) -> dict[str, Any]:
        """Return the specification as JSON-ready values."""
        strings = {"controller": str(self.controller), "reaction": str(self.reaction)}  # without an enumeration's type
        return {**asdict(self), **strings, "safety": dict(self.safety)}


@dataclass(frozen=True, slots=True)
class DemonstrationSpecification(_Asked):
    """One scripted demonstration: variations by number differ as a person's would.

    speed_m_s: of the pads at the object's surface, towards it; None: the variation's own.
    """

    kind: ClassVar[str] = "demonstration"
    object: str = "rice_box"
    variation: int = 0
    seed: int = 0
    speed_m_s: float | None = None


@dataclass(frozen=True, slots=True)
class SweepSpecification(_Asked):
    """One run of a friction identification: this joint (1 to 7) of both arms moves, the object is out of the way."""

    kind: ClassVar[str] = "identification"
    object: str
    joint: int
    run: int
    seed: int = 0


@dataclass(frozen=True, slots=True)
class FreeRunSpecification(_Asked):
    """One run along a part of a planned reference with nothing in the way: what friction compensation leaves of it.

    reference: its name; part: ante or post; seed: of the noise; robot: of the arms.
    """

    kind: ClassVar[str] = "identification"
    reference: str
    part: str
    run: int
    robot: int = 0
    seed: int = 0
    object: str = ""


@dataclass(frozen=True, slots=True)
class TeleoperationSpecification(_Asked):
    """An operator moves the arms by hand. recorded: as a recording; stop_on_release: a clutch that is let go ends it.

    job: the number that the operator's targets carry.
    """

    operator: str
    object: str = "rice_box"
    seed: int = 0
    recorded: bool = False
    stop_on_release: bool = True
    job: int = 0

    @property
    def kind(self) -> str:
        """What its log says."""
        return "recording" if self.recorded else "teleoperation"


@dataclass(frozen=True, slots=True)
class PlaybackSpecification(_Asked):
    """A log played on the arms, at `speed` times its own speed. source: its path, digest: SHA-256 of that file.

    object: empty, since nothing is meant to be met.
    """

    kind: ClassVar[str] = "playback"
    source: str
    speed: float = 1.0
    seed: int = 0
    digest: str = ""
    object: str = ""


class HandMotion(StrEnum):
    """A motion that an operator asks for, of arms that stand anywhere."""

    START = "start"  # away from the object, then home
    PUT_DOWN = "put_down"  # down until the table carries what both pads hold, then open
    OPEN = "open"  # both pads away from each other


@dataclass(frozen=True, slots=True)
class MoveSpecification(_Asked):
    """One motion, from where the arms are. object: what the cell holds."""

    kind: ClassVar[str] = "move"
    motion: HandMotion
    object: str = ""
    seed: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return the specification as JSON-ready values."""
        return asdict(self) | {"motion": str(self.motion)}


Specification = (
    TrialSpecification
    | DemonstrationSpecification
    | SweepSpecification
    | FreeRunSpecification
    | TeleoperationSpecification
    | PlaybackSpecification
    | MoveSpecification
)
