"""The arm study: its plan file in deploy/campaigns, and its tuning in deploy/tunings."""

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Positive, Real
from hal.pad import Pad
from rtstack.experiments.experiment import DIRECT
from rtstack.model.cell_description import ArmMounting, CellDescription, load_cell_description
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.outline import Case, ContactMap, Found, Outline, Portion, monitors_of, tuned_for
from rtstack.papers.aim_aware.platform.hit import HitGains
from rtstack.papers.conditions import files_of_plant

STUDY = "aim-aware-arm"
COMMAND = "python -m rtstack.papers.aim_aware.arm.tuning"
Rates = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
Count = Annotated[int, Field(ge=1, le=100)]


def platform_cell_file() -> Path:
    with as_file(files("deploy.cells") / "platform.toml") as path:
        return path


def platform_files() -> list[Path]:
    return files_of_plant("scenes/platform.toml", "parameters/plant.toml")


@checked(frozen=True, slots=True, config=STRICT)
class Setup:
    """The set-up of a hit. robot: which arm is drawn. inclination_deg, height_mm: standard deviations of the
    platform's.

    stiffness N/m, damping Ns/m, friction: of the contact, where it is not the scene's own.
    """

    robot: Annotated[int, Field(ge=0)]
    inclination_deg: NotNegative
    height_mm: NotNegative
    stiffness: Positive | None = None
    damping: Positive | None = None
    friction: Positive | None = None


@checked(frozen=True, slots=True, config=STRICT)
class ArmContacts(ContactMap):
    """Stiffness N/m and damping Ns/m of the whole face on the platform, its friction, and the approach speed m/s."""

    stiffness: tuple[Positive, ...]
    damping: tuple[Positive, ...]
    friction: tuple[Positive, ...]
    speed_m_s: tuple[Positive, ...]


@checked(frozen=True, slots=True, config=STRICT)
class ArmSearch:
    """noise_factor: r_b over the residual's largest rate in free motion; learning: nominal hits of an approach."""

    noise_factor: tuple[Positive, ...]
    learning: Count


@checked(frozen=True, slots=True, config=STRICT)
class ArmTuned:
    """Result of the tuning. quiet_nm_s (7,): largest rates of the residual in free motion; r_b is a multiple of them.

    learned: approach angle, degrees -> the pad's velocity after a nominal impact, x m/s, z m/s, about y rad/s.
    mirrored: whether the inclinations have the other sign than the paper's.
    """

    study_digest: str
    noise_factor: Positive
    quiet_nm_s: Rates
    residual_rate_nm_s: Rates
    mirrored: bool
    learned: dict[str, tuple[Real, Real, Real]]
    tunings: dict[str, Found]
    separations: dict[str, list[NotNegative]]
    left_out: dict[str, int]


@checked(frozen=True, slots=True, config=STRICT)
class ArmStudy(Outline):
    """The plan file of the study: the arm as its user knows it. logs: whether each judged hit has a log."""

    wanted_kind: ClassVar[str] = STUDY
    command: ClassVar[str] = COMMAND
    noisy: ClassVar[bool] = True
    seed: Annotated[int, Field(ge=0)]
    mounting: ArmMounting
    pad: Pad
    gains: HitGains
    setup: Setup
    tuning: ArmSearch
    contacts: ArmContacts
    logs: bool = False

    @property
    def description(self) -> CellDescription:
        return replace(_platform_cell(), left=self.mounting, pad=self.pad)

    def check(self, path: Path) -> None:
        Outline.check(self, path)
        both = set(self.grid.approach_deg.values()) & set(self.coarse.approach_deg.values())
        if both:
            raise ConfigurationError(f"{path}: key coarse: {min(both):g} deg is an approach that the report judges")


@lru_cache(maxsize=1)
def _platform_cell() -> CellDescription:
    return load_cell_description(platform_cell_file())


@dataclass(frozen=True, slots=True)
class LogFolder:
    """Where the logs of a campaign's hits are kept, an absolute path, and the campaign's digest, which they name."""

    path: Path
    digest: str


@dataclass(frozen=True, slots=True)
class ArmRun(Portion[ArmStudy, ArmTuned]):
    """The study or its sample. logs: None for none; cell: its kind (a person inclines a real platform)."""

    logs: LogFolder | None = None
    cell: str = DIRECT

    def monitors(self) -> dict[str, MonitorParameters]:
        """Return the tunings by name, and with the prefix paper_ those of Table 2 to the letter."""
        return monitors_of(self.study.tunings, self.tuned.tunings, self.tuned.residual_rate_nm_s)

    def batch_of(self, case: Case) -> tuple[int, float, float]:
        """Return the key of a batch: all but the repetition; in the map, all with one learned velocity."""
        return case.contact, case.approach_deg, 0.0 if case.contact else case.inclination_deg

    def at(self, contact: int) -> "ArmRun":
        """Return the study with contact number `contact` of the map, without learned velocities; 0: its own."""
        if not contact:
            return self
        values = dict(self.contacts[contact - 1])
        task = replace(self.study.task, speed_m_s=values.pop("speed_m_s"))
        study = replace(self.study, task=task, setup=replace(self.study.setup, **values))
        return replace(self, study=study, tuned=replace(self.tuned, learned={}))


def load_arm_run(path: Path, quick: bool) -> ArmRun:
    """Read a plan file and its tuning for this plant. Raises ConfigurationError with one line."""
    study = ArmStudy.load(path)
    tuned = tuned_for(path, study.name, ArmTuned, f"{COMMAND} {path}", platform_files())
    missing = [f"{deg:g}" for deg in study.grid.approach_deg.values() if f"{deg:g}" not in tuned.learned]
    if missing:
        raise ConfigurationError(f"{path}: no learned velocity for {missing[0]} deg: run `{COMMAND} {path}` again")
    return ArmRun.of(study, tuned, quick)
