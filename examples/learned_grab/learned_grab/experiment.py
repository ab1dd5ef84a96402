"""The campaign `learned-grab`: what a network learns from demonstrations, judged by success over displacements."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hal.base.configuration import load_toml
from learned_grab.plan import METHODS, Case, LearningPlan
from rtstack.cells import default_cell_file
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Stage, Stages, Task
from rtstack.experiments.report import Report
from rtstack.papers.simulated_cell import plant_files

COLUMNS = {
    "method": str, "radius_mm": float, "repetition": int, "displacement_mm": float, "displacement_x_mm": float,
    "yaw_deg": float, "success": bool, "reason": str, "max_lift_mm": float, "ticks": int,
}  # fmt: skip
_GROUP = 10  # demonstrations of a task


class LearnedGrab(Experiment[LearningPlan, Case]):
    """The kind of experiment. All methods are judged at the same places, with the same seeds."""

    def __init__(self, specification: LearningPlan, request: Request) -> None:
        sources = [request.file.path, default_cell_file(), *plant_files()]
        super().__init__(specification, request, COLUMNS, sources)

    @classmethod
    def plans(cls) -> Mapping[str, Path]:
        """Return the plan of the package."""
        return {"learned-grab": Path(__file__).with_name("learned-grab.toml")}

    @classmethod
    def read(cls, path: Path, quick: bool) -> LearningPlan:
        """See Experiment. The sample is of ten demonstrations and one trial at each distance."""
        plan = load_toml(path, LearningPlan)
        return replace(plan, demonstrations=10, repetitions=1, quick=True) if quick else plan

    def stages(self) -> Stages:
        """Demonstrate, record what reference spreading follows, and train."""
        from learned_grab import demonstrations as made

        plan, out = self.specification, self.request.out
        numbers = [range(k, min(k + _GROUP, plan.demonstrations)) for k in range(0, plan.demonstrations, _GROUP)]
        missing = [
            group for group in numbers
            if not all((out / made.DEMONSTRATIONS / f"{k:03d}.npz").exists() for k in group)
        ]  # fmt: skip
        tasks = [
            Task(
                f"demonstrations {group.start}", made.demonstrate, (out, plan.seed, group, plan.radius_mm, plan.yaw_deg)
            )
            for group in missing
        ]
        if not (out / made.RECORDING).exists():
            tasks.append(Task("reference", made.record, (out,)))
        if tasks:
            yield Stage("demonstrations", tasks)
        if not (out / made.NETWORK).exists():
            yield Stage("training", [Task("training", made.learn, (out, plan.seed))])

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """Return all trials."""
        plan = self.specification
        return [
            Case(method, radius, k) for radius in plan.radii_mm for k in range(plan.repetitions) for method in METHODS
        ]

    def tasks(self, cases: Sequence[Case]) -> Iterable[Task]:
        """Return a task for each trial."""
        from learned_grab.worker import run

        plan = self.specification
        return [Task(case.id, run, (self.request.out, plan.seed, plan.yaw_deg, case), (case,)) for case in cases]

    def report(self, results: Results) -> Report:
        """See learned_grab.report."""
        from learned_grab.report import report

        return report(results, self.specification, METHODS)
