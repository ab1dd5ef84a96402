"""The arm study of the collision-monitoring paper as a kind of experiment."""

from collections.abc import Callable, Sequence
from pathlib import Path

from rtstack.experiments.experiment import Request, Results, Row
from rtstack.experiments.report import Report
from rtstack.papers.aim_aware.arm.study import ArmRun, load_arm_run
from rtstack.papers.aim_aware.experiment import MonitorStudy
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.platform.setup import platform_files
from rtstack.papers.aim_aware.tuned import tuning_file


class PlatformStudy(MonitorStudy[ArmRun]):
    """Section IV-B: a simulated FR3 before an inclined platform."""

    def __init__(self, specification: ArmRun, request: Request) -> None:
        from rtstack.papers.aim_aware.arm.worker import columns

        sources = [request.file.path, *platform_files(), tuning_file(specification.name)]
        super().__init__(specification, request, columns(specification), sources)

    @classmethod
    def read(cls, path: Path, quick: bool) -> ArmRun:
        """See Experiment."""
        return load_arm_run(path, quick)

    def work(self) -> Callable[[ArmRun, Sequence[Case]], list[Row]]:
        """See MonitorStudy."""
        from rtstack.papers.aim_aware.arm.worker import run_hits

        return run_hits

    def report(self, results: Results) -> Report:
        """See rtstack.papers.aim_aware.arm.report."""
        from rtstack.papers.aim_aware.arm.report import report

        return report(self.specification, results)
