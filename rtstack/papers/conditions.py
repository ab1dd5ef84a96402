"""Under what a simulated grab is run: contact, scatter, the demonstrating hand, the law's inertia, the robot."""

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive
from rtstack.cells import IDEAL
from rtstack.references.demonstration import Grab
from rtstack.samples import LawInertia
from rtstack.trials.controllers import DEFAULT_DETECTOR, DetectorName

GRAVITY_M_S2 = 9.81
RECORDINGS, LOGS = "references", "logs"  # folders of a campaign


@checked(frozen=True, slots=True, config=STRICT)
class Hand:
    """How a demonstrating hand goes on after it has met the object: give either grip or depth_m.

    grip: on each pad at rest, as a multiple of the least force m g / (2 mu) that holds the object by friction. depth_m:
    of the hand's target at rest inside the object's surface. stop_s: from the surface to there; by default 2 depth /
    speed, an even stop (with less time the hand speeds up after the contact).
    """

    grip: Positive | None = None
    depth_m: Annotated[float, Field(gt=0.0, le=0.14)] | None = None
    stop_s: Annotated[float, Field(ge=0.02, le=1.0)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> "Hand":
        if (self.grip is None) == (self.depth_m is None):
            raise ValueError("give either grip or depth_m")
        return self

    def script(self, variation: Grab, mass_kg: float, pad_friction: float, stiffness_n_m: float) -> Grab:
        """Return a demonstration with this hand. stiffness_n_m: K_r towards the object, between target and pad.

        A variation keeps its own share of the depth: no two demonstrations are alike.
        """
        depth_m = self.depth_m
        if self.grip is not None:
            depth_m = self.grip * mass_kg * GRAVITY_M_S2 / (2.0 * pad_friction) / stiffness_n_m
        assert depth_m is not None
        depth_m *= variation.squeeze / Grab().squeeze
        return replace(variation, squeeze=depth_m, squeeze_s=self.stop_s or 2.0 * depth_m / variation.speed_y)


@checked(frozen=True, slots=True, config=STRICT)
class Conditions:
    """The contact of a trial, and how much it differs between repetitions. Scatter: standard deviations.

    pad_stiffness N/m; friction coefficients; friction_scatter: a fraction of pads' and table's; tau_ext_cutoff_hz:
    of the robot's filter of external torques; speed_m_s: of the pads at the object's surface in the demonstration.
    profile: of the simulated robot. hand: of the demonstration. law_inertia: in demonstration and trial. None: the
    variation's own, or the cell's. detector: of impacts in the trial.
    """

    pad_stiffness: Positive
    pad_friction: Positive
    table_friction: Positive
    friction_scatter: NotNegative
    placement_mm: NotNegative
    placement_yaw_deg: NotNegative
    tau_ext_cutoff_hz: Positive
    speed_m_s: Positive | None = None
    profile: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] = IDEAL
    hand: Hand | None = None
    law_inertia: LawInertia | None = None
    detector: DetectorName = DEFAULT_DETECTOR

    @property
    def plant(self) -> "Conditions":
        """What of them is the robot's and the table's, which no controller can set: the rest as by default."""
        return replace(self, speed_m_s=None, hand=None, law_inertia=None, detector=DEFAULT_DETECTOR)


@dataclass(frozen=True, slots=True)
class Reference:
    """This variation of the scripted demonstration, with this object. conditions: "" for the plan's first ones."""

    object: str
    variation: int
    conditions: str = ""

    @classmethod
    def named(cls, name: str) -> "Reference":
        """Return the reference of a name such as rice_box/3, or rice_box/3@fast where it has conditions of its own."""
        thing, _, rest = name.partition("/")
        variation, _, conditions = rest.partition("@")
        return cls(thing, int(variation), conditions)

    @property
    def name(self) -> str:
        """OBJECT/VARIATION, or OBJECT/VARIATION@CONDITIONS."""
        return f"{self.object}/{self.variation}" + f"@{self.conditions}" * bool(self.conditions)

    @property
    def file(self) -> str:
        return f"{self.name.replace('/', '-')}.mcap"


def files_of_plant(*names: str) -> list[Path]:
    """Return the paths of files of sim_robot."""
    return [Path(str(files("sim_robot") / name)) for name in names]
