"""What the arm study consists of, from its file in deploy/campaigns, and the tuning that was found for it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, ConfigurationError, NotNegative, Positive, Real
from hal.pad import Pad
from rtstack.model.cell_description import ArmMounting
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.grid import Case, Column, Found, monitors_of
from rtstack.papers.aim_aware.outline import Outline, Portion, load_outline
from rtstack.papers.aim_aware.platform.hit import HitGains, Hitter
from rtstack.papers.aim_aware.platform.setup import Setup, platform_files
from rtstack.papers.aim_aware.tuned import tuned_for

STUDY = "aim-aware-arm"
COMMAND = "python -m rtstack.papers.aim_aware.arm.tuning"
Seven = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
Count = Annotated[int, Field(ge=1, le=100)]


@checked(frozen=True, slots=True, config=STRICT)
class ArmColumn(Column):
    """A column of Table 2, and the inclinations that Figure 8 always has as expected: from and to, degrees.

    ambiguity_deg: so far beyond the band the tuning is to expect nothing any more.
    """

    always_deg: tuple[Real, Real]
    ambiguity_deg: Positive

    @property
    def band(self) -> tuple[float, float]:
        """From and to, degrees."""
        return self.always_deg

    def mirrored(self) -> "ArmColumn":
        """Return the same with inclinations of the other sign."""
        low, high = self.always_deg
        return replace(self, always_deg=(0.0 - high, 0.0 - low))


@checked(frozen=True, slots=True, config=STRICT)
class ArmSearch:
    """What the tuning may choose from, and what it is to reach: see tuning.py.

    noise_factor: candidates for r_b over the residual's largest rate in free motion; learning: nominal hits from which
    an approach angle's post-impact velocity is learned.
    """

    noise_factor: tuple[Positive, ...]
    learning: Count


@checked(frozen=True, slots=True, config=STRICT)
class Thresholds:
    """When a claim holds: degrees from the paper's edge; the width of an ambiguous area; a difference of both sides."""

    within_deg: Positive
    ambiguity_deg: Positive
    asymmetry_deg: Positive


@checked(frozen=True, slots=True, config=STRICT)
class ArmTuned:
    """What the tuning found. quiet_nm_s (7,): the residual's largest rates in free motion, which r_b is a multiple of.

    learned: approach angle, degrees -> the pad's velocity after a nominal impact, x m/s, z m/s, about y rad/s.
    mirrored: whether the inclinations have the other sign than the paper's. separations, left_out: of each candidate.
    """

    study_digest: str
    noise_factor: Positive
    quiet_nm_s: Seven
    residual_rate_nm_s: Seven
    mirrored: bool
    learned: dict[str, tuple[Real, Real, Real]]
    tunings: dict[str, Found]
    separations: dict[str, list[NotNegative]]
    left_out: dict[str, int]


@checked(frozen=True, slots=True, config=STRICT)
class ArmStudy(Outline):
    """The study as its file has it: the arm as its user knows it, not what the plant is."""

    seed: Annotated[int, Field(ge=0)]
    mounting: ArmMounting
    pad: Pad
    gains: HitGains
    setup: Setup
    tuning: ArmSearch
    claims: Thresholds
    tunings: dict[str, ArmColumn]

    @property
    def hitter(self) -> Hitter:
        """The arm."""
        return Hitter(self.mounting, self.pad, self.gains)

    def check(self, path: Path) -> None:
        """Raise ConfigurationError where the parts do not fit together."""
        self.check_points(path, "quick")
        both = set(self.grid.approach_deg.values()) & set(self.coarse.approach_deg.values())
        if both:
            raise ConfigurationError(f"{path}: key coarse: {min(both):g} deg is an approach that the report judges")


@dataclass(frozen=True, slots=True)
class ArmRun(Portion[ArmStudy, ArmTuned]):
    """The study, or a sample of it."""

    @property
    def columns(self) -> dict[str, ArmColumn]:
        """The columns of Table 2, their bands with the signs of our inclinations."""
        columns = self.study.tunings
        return {name: column.mirrored() for name, column in columns.items()} if self.tuned.mirrored else columns

    def monitors(self) -> dict[str, MonitorParameters]:
        """Return the tunings by name, and with the prefix paper_ those of Table 2 to the letter."""
        return monitors_of(self.study.tunings, self.tuned.tunings, self.tuned.residual_rate_nm_s)

    def batch_of(self, case: Case) -> tuple[float, float]:
        """Return what a case shares with those that are run with it: all but the repetition."""
        return case.approach_deg, case.inclination_deg


def load_arm_study(path: Path) -> ArmStudy:
    """Read and check a study. Raises ConfigurationError with one line."""
    return load_outline(path, ArmStudy, STUDY)


def load_arm_run(path: Path, quick: bool) -> ArmRun:
    """Read a study with the tuning that was found for it, on its plant. Raises ConfigurationError with one line."""
    study = load_arm_study(path)
    tuned = tuned_for(path, study.name, ArmTuned, f"{COMMAND} {path}", platform_files())
    missing = [f"{deg:g}" for deg in study.grid.approach_deg.values() if f"{deg:g}" not in tuned.learned]
    if missing:
        raise ConfigurationError(f"{path}: no velocity was learned for {missing[0]} deg: run `{COMMAND} {path}` again")
    return ArmRun(study, tuned, quick)
