"""Demonstrations that the trials of a campaign follow: how a worker records them, and what all its trials share."""

from collections.abc import Callable, Generator, Iterable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from hal.displacement import Displacement
from rtstack.cells import with_profile
from rtstack.experiments.archive import Archive
from rtstack.experiments.experiment import CellRun, Stage, Task
from rtstack.experiments.seeds import seed_of
from rtstack.log.writing.job import Attachment
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.papers.conditions import RECORDINGS, Conditions, Reference
from rtstack.papers.simulated_cell import BuiltCell, conditioned_cell
from rtstack.references.demonstration import grab
from rtstack.safety.limits import HARDWARE
from rtstack.samples import LawInertia
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.carry_out import PreparedRun, R, carry_out
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.record import RunSamples, WholeRunLog, cell_attachments, whole_run_log
from rtstack.trials.result import DemonstrationResult
from rtstack.trials.scoring import SuccessCriterion
from rtstack.trials.specification import DemonstrationSpecification, Specification

# Without a person in the cell a demonstration may hit as hard as a trial: plans ask for faster ones than the judge lets
# hands make (rtstack.safety.limits). What the cell's file says holds.
_AS_AN_IMPACT = {name: getattr(HARDWARE, name) for name in ("tau_ext_contact_max", "force_contact_max")}


@lru_cache(maxsize=4)
def _described(cell_file: Path) -> tuple[CellDescription, list[Attachment]]:
    """Return the description in a cell's file, and what every log of a campaign has attached."""
    description = load_cell_description(cell_file)
    return description, cell_attachments(cell_file, description)


@dataclass(frozen=True, slots=True)
class CampaignBench:
    """What all runs of a campaign have in common, for the workers: absolute paths. cell: its kind; digest: the
    campaign's.
    """

    out: Path
    cell: str
    cell_file: Path
    digest: str

    @property
    def description(self) -> CellDescription:
        return _described(self.cell_file)[0]

    def log(
        self, path: Path, specification: Specification, law_inertia: LawInertia, kind: str | None = None, **more: Any
    ) -> WholeRunLog:
        """Return the log of a run. kind: of the cell, if not its own; more: see whole_run_log."""
        description, attachments = _described(self.cell_file)
        kind = kind or self.cell
        return whole_run_log(path, specification, description, attachments, kind, law_inertia=law_inertia, **more)

    def run(self, prepared: PreparedRun[R], built: BuiltCell, log: RunSamples) -> tuple[R, Columns]:
        """Carry out a run that has to be logged. Returns its result and samples. Raises OSError without a log."""
        result = carry_out(prepared, built.host(self.cell, log))
        if log.columns is None or not log.path.exists():
            raise OSError(result.failure_reason)
        return result, log.columns


@dataclass(frozen=True, slots=True)
class Bench(CampaignBench):
    """elsewhere: of recordings and logs, for fsspec, if not in `out`. lab_file: a cell_file with its own objects."""

    criterion: SuccessCriterion
    elsewhere: str | None = None
    lab_file: Path | None = None

    @property
    def archive(self) -> Archive:
        return Archive(self.elsewhere or str(self.out))

    def built_cell(self, object_name: str, displacement: Displacement, seed: int, conditions: Conditions) -> BuiltCell:
        return conditioned_cell(object_name, displacement, seed, conditions, cell_file=self.lab_file)


def campaign_record(case: Any, digest: str) -> dict[str, str]:
    """Return the metadata record `campaign` of the log of a case, a dataclass with an id."""
    return record_of(case) | {"id": case.id, "digest": digest}


def record_of(case: Any) -> dict[str, str]:
    return {key: str(value) for key, value in asdict(case).items()}


def _demonstration(
    bench: Bench, reference: Reference, conditions: Conditions, seed: int
) -> PreparedRun[DemonstrationResult]:
    description = replace(bench.description, safety=_AS_AN_IMPACT | bench.description.safety)
    specification = DemonstrationSpecification(
        reference.object, reference.variation, seed, conditions.speed_m_s, law_inertia=conditions.law_inertia
    )
    if conditions.hand is not None:
        thing = bench.description.objects[reference.object]
        script = conditions.hand.script(
            grab(reference.variation, conditions.speed_m_s), thing.mass, thing.pad_friction or conditions.pad_friction,
            float(cell_parameters(bench.description).control.stiffness_teleoperation[1]),
        )  # fmt: skip
        specification = replace(specification, squeeze_m=script.squeeze, squeeze_s=script.squeeze_s)
    return prepare_demonstration(specification, description)


def record(bench: Bench, reference: Reference, conditions: Conditions, seed: int) -> str | None:
    """Record a demonstration. Returns None, or in one line why there is none."""
    prepared = _demonstration(bench, reference, conditions, seed)
    kind, law = with_profile(bench.cell, conditions.profile), bench.description.gains.law_inertia
    with bench.archive.new(f"{RECORDINGS}/{reference.file}") as path:
        log = bench.log(path, prepared.specification, law, kind)
        built = bench.built_cell(reference.object, Displacement(), seed, conditions)
        return carry_out(prepared, built.host(bench.cell, log)).failure_reason


def recording_stages(
    bench: Bench, references: Iterable[Reference], conditions: Callable[[Reference], Conditions], seed: int
) -> Generator[Stage, dict[str, str], dict[str, str]]:
    """Record the references that are missing, under their conditions. Returns by name why one is not recorded."""
    there = bench.archive.names(RECORDINGS)
    missing = [reference for reference in references if reference.file not in there]
    arguments = {
        f"reference-{one.name}": (bench, one, conditions(one), seed_of(seed, "reference", one.name)) for one in missing
    }
    tasks = [Task(name, record, each) for name, each in arguments.items()]

    def on_arms(name: str) -> CellRun:
        log = bench.out / RECORDINGS / arguments[name][1].file
        return CellRun(_demonstration(*arguments[name]), log, wanted=Displacement())

    failed = yield Stage("references", tasks, on_arms)
    unrecorded = {one.name: failed[task.name] for one, task in zip(missing, tasks, strict=True) if task.name in failed}
    for name in unrecorded:
        bench.archive.remove(f"{RECORDINGS}/{Reference.named(name).file}")
    return unrecorded
