"""The planar study: its plan file in deploy/campaigns, and its tuning in deploy/tunings."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.outline import Case, ContactMap, Found, Outline, Portion, monitors_of, tuned_for
from rtstack.papers.aim_aware.planar.parameters import Contact, Gains, PlanarArm

STUDY = "aim-aware-planar"


@checked(frozen=True, slots=True, config=STRICT)
class PlanarContacts(ContactMap):
    """Values of the contact law (see Contact), and of r_b in Nm/s."""

    stiffness: tuple[Positive, ...]
    damping_s_m: tuple[NotNegative, ...]
    residual_rate_nm_s: tuple[Positive, ...]


@checked(frozen=True, slots=True, config=STRICT)
class Search:
    """Candidates for r_b: see rtstack.papers.aim_aware.tuning."""

    residual_rate_nm_s: tuple[Positive, ...]


@checked(frozen=True, slots=True, config=STRICT)
class Tuned:
    """Result of the tuning for the plan file with this digest. separations: by candidate for r_b."""

    study_digest: str
    residual_rate_nm_s: Positive
    tunings: dict[str, Found]
    separations: dict[str, list[NotNegative]]


@checked(frozen=True, slots=True, config=STRICT)
class Study(Outline):
    """The plan file of the study."""

    wanted_kind: ClassVar[str] = STUDY
    command: ClassVar[str] = "python -m rtstack.papers.aim_aware.tuning"
    arm: PlanarArm
    contact: Contact
    gains: Gains
    tuning: Search
    contacts: PlanarContacts

    def check(self, path: Path) -> None:
        Outline.check(self, path)
        self.check_points(path, "coarse")


@dataclass(frozen=True, slots=True)
class StudyRun(Portion[Study, Tuned]):
    """The study or its sample."""

    def monitors(self) -> dict[str, MonitorParameters]:
        """Return the three tunings by name, and with the prefix paper_ those of Table 1 to the letter."""
        return monitors_of(self.study.tunings, self.tuned.tunings, (self.tuned.residual_rate_nm_s,) * 3)

    def batch_of(self, case: Case) -> tuple[int, float, float]:
        return case.contact, case.approach_deg, case.location_m

    def at(self, contact: int) -> "StudyRun":
        """Return the study with contact number `contact` of the map; 0: its own."""
        if not contact:
            return self
        values = self.contacts[contact - 1]
        law = replace(self.study.contact, stiffness=values["stiffness"], damping_s_m=values["damping_s_m"])
        tuned = replace(self.tuned, residual_rate_nm_s=values["residual_rate_nm_s"])
        return replace(self, study=replace(self.study, contact=law), tuned=tuned)


def load_run(path: Path, quick: bool) -> StudyRun:
    """Read a plan file and its tuning. Raises ConfigurationError with one line."""
    study = Study.load(path)
    return StudyRun.of(study, tuned_for(path, study.name, Tuned, f"{study.command} {path}"), quick)
