"""One case in a worker: a trial without a log, and what the monitor has said about it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

from rtstack.experiments.experiment import Row
from rtstack.model.cell_description import load_cell_description
from rtstack.monitor.pair import PairParameters
from rtstack.papers.aim_aware.grab.cases import FaultKind, Faults, GrabCase
from rtstack.papers.conditions import RECORDINGS, Conditions, Reference
from rtstack.papers.demonstrations import Bench
from rtstack.papers.simulated_cell import conditioned_cell
from rtstack.trials.carry_out import carry_out
from rtstack.trials.specification import TrialSpecification, like
from rtstack.trials.trial import PreparedTrial, prepare_trial


@dataclass(frozen=True, slots=True)
class GrabBench:
    """What all cases have in common, as it is sent to the workers. monitors: of each object."""

    bench: Bench
    conditions: Conditions
    faults: Faults
    monitors: Mapping[str, PairParameters]


@dataclass(frozen=True, slots=True)
class GrabOutcome:
    """What became of a case. Times in s from the start of the trial; onset_s: of what went wrong, or of the impact."""

    id: str
    fault: str | None
    reference: str
    displacement_mm: float
    seed: int
    verdict: str
    reason: str | None
    kind: str | None
    margin: float
    verdict_s: float | None
    onset_s: float
    nominal_s: float
    success: bool
    failure_reason: str | None
    ticks: int

    @property
    def object(self) -> str:
        return Reference.named(self.reference).object

    @property
    def unexpected(self) -> bool:
        return self.verdict == "unexpected"

    @property
    def right(self) -> bool:
        """Whether the verdict is right; one that comes before what goes wrong is a false alarm."""
        if self.fault is None:
            return not self.unexpected
        early = self.fault == FaultKind.PUSH and self.verdict_s is not None and self.verdict_s < self.onset_s
        return self.unexpected and not early

    @property
    def delay_s(self) -> float | None:
        return None if self.verdict_s is None else self.verdict_s - self.onset_s


@lru_cache(maxsize=16)
def _prepared(cell_file: Path, out: Path, reference: Reference, monitor: PairParameters) -> PreparedTrial:
    specification = TrialSpecification(str(out / RECORDINGS / reference.file), object=reference.object)
    return prepare_trial(specification, load_cell_description(cell_file), monitor=monitor)


def run_case(grab: GrabBench, case: GrabCase) -> list[Row]:
    bench = grab.bench
    prepared = _prepared(bench.cell_file, bench.out, case.reference, grab.monitors[case.reference.object])
    assert prepared.reference.impact is not None  # it is a demonstration
    script = case.script(grab.faults, prepared.reference.impact)
    specification = replace(prepared.specification, displacement_mm=case.displacement_mm, seed=case.seed)
    prepared = replace(prepared, specification=specification, criterion=bench.criterion)
    built = conditioned_cell(
        case.reference.object, specification.displacement, case.seed, grab.conditions, script,
        case.wider_mm(grab.faults),
    )  # fmt: skip
    result = carry_out(prepared, built.host(bench.cell))
    nominal_s = result.nominal_impact_time_s
    hit_s = result.detected_impact_time_s if result.detected_impact_time_s is not None else nominal_s
    finding = like(
        GrabOutcome, result, case, reference=case.reference.name, verdict=result.impact_verdict or "none",
        reason=result.impact_reason, kind=result.impact_kind, verdict_s=result.impact_verdict_time_s,
        margin=result.impact_margin if result.impact_margin is not None else 0.0,
        onset_s=script[0]["at_s"] if case.fault is FaultKind.PUSH else hit_s, nominal_s=nominal_s,
    )  # fmt: skip
    return [asdict(finding)]
