"""The arm study of the collision-monitoring paper as a kind of experiment."""

from dataclasses import replace
from pathlib import Path

from rtstack.experiments.experiment import Request, Stages
from rtstack.papers.aim_aware.arm.study import ArmRun, LogFolder, load_arm_run
from rtstack.papers.aim_aware.experiment import MonitorStudy
from rtstack.papers.aim_aware.platform.setup import platform_cell_file, platform_files
from rtstack.papers.aim_aware.tuned import tuning_file

LOGS = "logs"


class PlatformStudy(MonitorStudy[ArmRun]):
    """Section IV-B: a simulated FR3 before an inclined platform."""

    options = frozenset({"cell"})
    package = "rtstack.papers.aim_aware.arm"

    def __init__(self, specification: ArmRun, request: Request) -> None:
        from rtstack.papers.aim_aware.arm.worker import columns

        sources = [platform_cell_file(), *platform_files(), tuning_file(specification.name)]
        super().__init__(specification, request, columns(specification), sources)
        logs = LogFolder(request.out / LOGS, self.digest) if specification.study.logs else None
        self.specification = replace(specification, logs=logs, cell=request.simulated_cell)

    def stages(self) -> Stages:
        """Make the folder of the logs, where there are some; see MonitorStudy."""
        if self.specification.logs is not None:
            self.specification.logs.path.mkdir(exist_ok=True)
        yield from super().stages()

    @classmethod
    def read(cls, path: Path, quick: bool) -> ArmRun:
        """See Experiment."""
        return load_arm_run(path, quick)
