"""The arm study of the collision-monitoring paper as a kind of experiment."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rtstack.experiments.experiment import SIMULATED, CellRun, Request, Row, Stages
from rtstack.papers.aim_aware.arm.study import ArmRun, LogFolder, load_arm_run, platform_cell_file, platform_files
from rtstack.papers.aim_aware.experiment import MonitorStudy
from rtstack.papers.aim_aware.outline import Case, tuning_file
from rtstack.papers.conditions import LOGS

if TYPE_CHECKING:
    from rtstack.log.reader import Log


class PlatformStudy(MonitorStudy[ArmRun]):
    """Section IV-B: a simulated FR3 before an inclined platform."""

    options = frozenset({"cell"})
    package = "rtstack.papers.aim_aware.arm"
    setup = "set the platform to 0 degrees"
    on_stack = False

    def __init__(self, specification: ArmRun, request: Request) -> None:
        sources = [platform_cell_file(), *platform_files(), tuning_file(specification.name)]
        super().__init__(specification, request, self.part("worker").columns(specification), sources)
        logs = LogFolder(request.out / LOGS, self.digest) if specification.study.logs else None
        self.specification = replace(specification, logs=logs, cell=request.simulated_cell)

    @property
    def cell_file(self) -> Path:
        return platform_cell_file()

    def stages(self) -> Stages:
        """Make the folder of the logs, where there are some; see MonitorStudy."""
        if self.specification.logs is not None:
            self.specification.logs.path.mkdir(exist_ok=True)
        if self.request.cell in SIMULATED:
            yield from super().stages()

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """See MonitorStudy. An arm has no other contact than its own."""
        simulated = self.request.cell in SIMULATED
        return [case for case in super().cases(rows) if simulated or not case.contact]

    def size(self) -> int:
        return len(self.cases(()))

    def on_cell(self, case: Case) -> CellRun:
        """See Experiment. The platform stands where the plan has it: x 0.51 m, height 0.15 m."""
        return self.part("worker").on_arms(self.specification, case, self.request.out / LOGS / f"{case.id}.mcap")

    def row_of_log(self, case: Case, log: "Log") -> Row:
        return self.part("worker").row_of_log(self.specification, case, log)

    @classmethod
    def read(cls, path: Path, quick: bool) -> ArmRun:
        return load_arm_run(path, quick)
