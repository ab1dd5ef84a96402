"""Experiment kind that judges the grab's monitor, on good and faulty grabs that it was not tuned on."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stages, Task
from rtstack.experiments.registration import check_claims
from rtstack.experiments.report import Report
from rtstack.experiments.store import columns_of
from rtstack.papers.aim_aware.grab.cases import GrabCase, Judged, load_judged
from rtstack.trials.errors import TrialError


class GrabStudy(Experiment[Judged, GrabCase]):
    """Good grabs of several objects, and grabs with a fault, judged by the monitor."""

    options = frozenset({"cell"})

    def __init__(self, specification: Judged, request: Request) -> None:
        from rtstack.cells import load_description
        from rtstack.papers.aim_aware.grab.report import JUDGES
        from rtstack.papers.aim_aware.grab.worker import GrabBench, GrabOutcome
        from rtstack.papers.demonstrations import Bench
        from rtstack.papers.simulated_cell import plant_files
        from rtstack.trials.monitoring import tuning_of
        from rtstack.trials.scoring import SuccessCriterion

        check_claims(request.file.path, specification.claims, JUDGES)
        monitors, self._tunings = {}, {}
        for name in specification.objects:
            tuning = tuning_of(name)
            if tuning is None:
                raise TrialError(
                    f"there is no tuning for {name}: make deploy/monitor/{name}.toml with `rtstack tune-monitor`"
                )
            monitors[name], self._tunings[name] = tuning.monitor, tuning.provenance
        cell_file = load_description(None)[1]
        super().__init__(specification, request, columns_of(GrabOutcome), [cell_file, *plant_files()], also=monitors)
        bench = Bench(request.out, request.simulated_cell, cell_file, self.digest, SuccessCriterion())
        self._grab = GrabBench(bench, specification.conditions, specification.faults, monitors)

    @classmethod
    def read(cls, path: Path, quick: bool) -> Judged:
        return load_judged(path, quick)

    def stages(self) -> Stages:
        from rtstack.papers.demonstrations import recording_stages

        study = self.specification
        unrecorded = yield from recording_stages(
            self._grab.bench, study.recorded(), lambda _: study.conditions, study.seed
        )
        for name, reason in unrecorded.items():
            raise TrialError(f"the reference {name} could not be recorded: {reason}")

    def cases(self, rows: Sequence[Row]) -> list[GrabCase]:
        return self.specification.cases()

    def tasks(self, cases: Sequence[GrabCase]) -> Iterable[Task]:
        from rtstack.papers.aim_aware.grab.worker import run_case

        return [Task(case.id, run_case, (self._grab, case), (case,)) for case in cases]

    def report(self, results: Results) -> Report:
        from rtstack.papers.aim_aware.grab.report import report

        return report(self._tunings, results, self.specification.claims)
