"""The campaign `reality`: a case is a comparison whose set of measurements is in the folder of data."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, load_toml
from reality import hits, human_force, link, torque, tosses
from reality.comparison import Comparison
from rtstack.experiments.experiment import Experiment, Request, Results, Row, Task
from rtstack.experiments.report import Report
from rtstack.trials.errors import TrialError

COMPARISONS = {each.name: each for each in (
    Comparison(
        "panda_dynamics", "Joint torques of a real Panda",
        [f"exciting_traj_{name}.txt" for name in ("positions", "velocity", "torques", "time")],
        "The torque measured on an exciting trajectory of 21 s, less what hal/robots/fer.toml says of it. "
        "Fitted on the first half, judged on the second.",
        "the four files of matlab/data/Exciting_Traj/Trajectory_1/rbt_log in the GitHub repository "
        "marcocognetti/FrankaEmikaPandaDynModel", "GPL-3", torque.compare,
    ),
    Comparison(
        "air_hockey", "Boxes that a real arm hits", ["*.csv"],
        "The speed at which a box leaves the hand, from how far it slides. Fitted on every second hit, judged on the "
        "others; and the light box's number, judged on the heavy box.",
        "tables of data/airhockey_processed in the GitHub repository epfl-lasa/air_hockey: raw/D5.csv, "
        "clean/for_paper/D1-robot_agnostic.csv, clean/KL_div-object_agnostic/D2_clean_clean.csv",
        "none stated: for a comparison of your own, not to be passed on", hits.compare,
    ),
    Comparison(
        "cube_tosses", "Tosses of a real cube", ["**/tosses_processed/*.pt"],
        "A cube is tossed onto a table; MuJoCo, which computes the plant's contacts, begins with the toss's first "
        "pose and velocity. Fitted on every fifth toss, judged on the others; the error is averaged over a toss.",
        "the folder data of the GitHub repository DAIRLab/contact-nets", "BSD-3-Clause", tosses.compare,
    ),
    Comparison(
        "co_manipulation", "A person's force on a real Panda", ["**/symbol_data.mat"],
        "A person draws symbols with the robot's hand; a force sensor measures the force. Whatever the impact detector "
        "finds is a false alarm.",
        "files symbol_data.mat of the GitHub repository AutoLabModena/Panda-Co-Manipulation-Dataset", "MIT",
        human_force.compare,
    ),
    Comparison(
        "fr3_link", "The link to a real FR3", [link.RUNS],
        "The time between two states, as the client sees it, in torque control.",
        "the files cpp_model_rt_r* and rust_model_rt_r* of bench/results/20260904T162559-hw in the GitHub repository "
        "BarisYazici/franka-rs", "Apache-2.0", link.compare,
    ),
)}  # fmt: skip


@checked(frozen=True, slots=True, config=STRICT)
class RealityPlan:
    """A plan's file. comparisons: names of COMPARISONS; sample: those of --quick."""

    kind: Literal["reality"]
    name: str
    title: str
    comparisons: tuple[str, ...]
    sample: tuple[str, ...]
    quick: bool = False

    def size(self) -> int:
        """Return the number of comparisons."""
        return len(self.comparisons)


@dataclass(frozen=True, slots=True)
class Case:
    """A comparison."""

    id: str


class Reality(Experiment[RealityPlan, Case]):
    """The kind of experiment. A set that is not there is left out, and said with how to get it."""

    options = frozenset({"data"})
    unit = "comparisons"

    def __init__(self, specification: RealityPlan, request: Request) -> None:
        if request.data is None:
            raise TrialError("reality compares with measurements of others: give the folder that has them as --data; "
                             "docs/reality.md says how to fill it")  # fmt: skip
        found = {name: COMPARISONS[name].found(request.data) for name in specification.comparisons}
        self.missing = [COMPARISONS[name] for name, files in found.items() if not files]
        if len(self.missing) == len(found):
            first = self.missing[0]
            raise TrialError(
                f"{request.data} has none of the folders {', '.join(found)}; {first.name} is {first.obtain}"
            )
        sources = [request.file.path, *(path for files in found.values() for path in files)]
        super().__init__(specification, request, {"samples": int, "held_out": int, "finding": str}, sources)

    @classmethod
    def plans(cls) -> Mapping[str, Path]:
        """Return the plan of the package."""
        return {"reality": Path(__file__).with_name("reality.toml")}

    @classmethod
    def read(cls, path: Path, quick: bool) -> RealityPlan:
        plan = load_toml(path, RealityPlan)
        for name in plan.comparisons + plan.sample:
            if name not in COMPARISONS:
                raise ConfigurationError(f"{path}: key comparisons: {name!r} is none of {', '.join(COMPARISONS)}")
        return replace(plan, comparisons=plan.sample, quick=True) if quick else plan

    def size(self) -> int:
        """Return how many sets are there."""
        return len(self.cases(()))

    def cases(self, rows: Sequence[Row]) -> list[Case]:
        """Return the comparisons whose set is there."""
        missing = {each.name for each in self.missing}
        return [Case(name) for name in self.specification.comparisons if name not in missing]

    def tasks(self, cases: Sequence[Case]) -> Iterable[Task]:
        """Return a task for each comparison."""
        return [Task(case.id, run, (case.id, self.request.data), (case,)) for case in cases]

    def report(self, results: Results) -> Report:
        """See report.py."""
        from reality.report import report

        return report(results, COMPARISONS, self.missing)


def run(name: str, data: Path) -> list[Row]:
    """Make a comparison. Returns its row."""
    finding = COMPARISONS[name].compare(data / name)
    numbers = json.dumps(finding.as_dict())
    return [{"id": name, "samples": finding.samples, "held_out": finding.held_out, "finding": numbers}]
