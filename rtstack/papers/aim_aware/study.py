"""What the planar study consists of, from its file in deploy/campaigns, and the tuning that was found for it."""

from dataclasses import dataclass
from pathlib import Path

from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, NotNegative, Positive
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.grid import Case, Column, Found, monitors_of
from rtstack.papers.aim_aware.outline import Outline, Portion, load_outline
from rtstack.papers.aim_aware.planar.parameters import Contact, Gains, PlanarArm
from rtstack.papers.aim_aware.tuned import tuned_for

STUDY = "aim-aware-planar"
COMMAND = "python -m rtstack.papers.aim_aware.tuning"


@checked(frozen=True, slots=True, config=STRICT)
class PlanarColumn(Column):
    """A column of Table 1, and the inclinations that Figure 7 always has as expected: |beta| <= always_deg."""

    always_deg: NotNegative

    @property
    def band(self) -> tuple[float, float]:
        """From and to, degrees."""
        return -self.always_deg, self.always_deg


@checked(frozen=True, slots=True, config=STRICT)
class Search:
    """What the tuning may choose from, and what it is to reach: see rtstack.papers.aim_aware.tuning."""

    residual_rate_nm_s: tuple[Positive, ...]
    ambiguity_deg: Positive


@checked(frozen=True, slots=True, config=STRICT)
class Tuned:
    """What the tuning found for the study file of this digest. separations: of each candidate for r_b."""

    study_digest: str
    residual_rate_nm_s: Positive
    tunings: dict[str, Found]
    separations: dict[str, list[NotNegative]]


@checked(frozen=True, slots=True, config=STRICT)
class Study(Outline):
    """The study as its file has it."""

    arm: PlanarArm
    contact: Contact
    gains: Gains
    tuning: Search
    tunings: dict[str, PlanarColumn]

    def check(self, path: Path) -> None:
        """Raise ConfigurationError where the parts do not fit together."""
        self.check_points(path, "quick", "coarse")


@dataclass(frozen=True, slots=True)
class StudyRun(Portion[Study, Tuned]):
    """The study, or a sample of it."""

    def monitors(self) -> dict[str, MonitorParameters]:
        """Return the three tunings by name, and with the prefix paper_ those of Table 1 to the letter."""
        rates = (self.tuned.residual_rate_nm_s,) * 3
        return monitors_of(self.study.tunings, self.tuned.tunings, rates)

    def batch_of(self, case: Case) -> tuple[float, float]:
        """Return what a case shares with those that are run with it: its plan."""
        return case.approach_deg, case.location_m


def load_study(path: Path) -> Study:
    """Read and check a study. Raises ConfigurationError with one line."""
    return load_outline(path, Study, STUDY)


def load_run(path: Path, quick: bool) -> StudyRun:
    """Read a study with the tuning that was found for it. Raises ConfigurationError with one line."""
    study = load_study(path)
    return StudyRun(study, tuned_for(path, study.name, Tuned, f"{COMMAND} {path}"), quick)
