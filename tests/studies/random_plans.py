"""Random plans: of those that are accepted, how many succeed; of those that are refused, how many would have.

Each seed draws a motion (one of five is a push), an object of the cell, its mass (as the cell says, or, of two out of
five, any of MASSES: the simulated object weighs the same), the pads' height on it, and speed and rise within what a
plan may be asked for; one of five takes the plan's defaults, as `rtstack plan --object` does. A plan that is accepted
is followed once, on the plant in this process, with arms and noise of the same seed. Of the refused ones every second
is followed too, by the function below the checks (grab_motion, push_motion), with the safety judge and the robot's
reflexes as they are; a plan of which there is no motion cannot be tried.

Takes ten minutes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np
from scipy.stats import binomtest

from rtstack.cells import default_cell_file
from rtstack.experiments.experiment import Row
from rtstack.experiments.report import Table
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.planning import GrabPlan, PlanError, PlannedMotion, PushPlan, TooFast, plan_grab, plan_push
from rtstack.planning.file import write_plan
from rtstack.planning.grab import grab_motion
from rtstack.planning.push import push_motion
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import simulated_cell
from sim_robot.plant_parameters import load_plant_parameters
from tests.studies.study import Case, Study

WANTED = 0.98
MASSES = (0.3, 5.0)  # kg
SPEEDS, RISES = (0.05, 0.8), (0.1, 0.5)  # m/s
PUSHES, OTHER_MASSES, DEFAULTS = 0.2, 0.4, 0.2  # shares
EDGE_M = 1e-3  # of the room that the pads have on the object's face
SCENE = Path(__file__).resolve().parents[2] / "sim_robot/scenes/grab.toml"


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a seed asks for. keys: of the plan; none where the plan's defaults are taken."""

    object: str
    mass: float
    push: bool
    keys: dict[str, float]

    @property
    def request(self) -> GrabPlan | PushPlan:
        """The plan."""
        return PushPlan(**self.keys) if self.push else GrabPlan(**self.keys)

    def __str__(self) -> str:
        keys = ", ".join(f"{key} {value:g}" for key, value in self.keys.items()) or "defaults"
        return f"{'push' if self.push else 'grab'} of {self.object}, {self.mass:g} kg, {keys}"


def drawn(seed: int, cell: CellDescription) -> Drawn:
    """Return what a seed asks for, in mm, cm/s and tens of grams as a person would."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(cell.objects)))
    thing = cell.objects[name]
    mass = round(float(rng.uniform(*MASSES)), 2) if rng.random() < OTHER_MASSES else thing.mass
    push, default = bool(rng.random() < PUSHES), bool(rng.random() < DEFAULTS)
    room = (thing.size[2] - cell.pad.size[1]) / 2 - EDGE_M
    height = round(float(rng.uniform(max(-room, 0.005 - room), room)), 3)
    speed, rise = (round(float(rng.uniform(*bounds)), 2) for bounds in (SPEEDS, RISES))
    keys = {"speed": speed, "height": height} if push else {"speed": speed, "rise": rise, "height": height}
    return Drawn(name, mass, push, {} if default else keys)


def planned(cell: CellDescription, thing: str, request: GrabPlan | PushPlan, checked: bool = True) -> PlannedMotion:
    """Return the motion, or one that no check has seen."""
    if isinstance(request, GrabPlan):
        return (plan_grab if checked else grab_motion)(cell, thing, request)
    return (plan_push if checked else push_motion)(cell, thing, request)


def followed(motion: PlannedMotion, cell: CellDescription, asked: Drawn, seed: int) -> Row:
    """Write the plan, read it back and follow it on the plant in this process, whose object has the mass asked for."""
    with TemporaryDirectory() as folder:
        path, scene = Path(folder) / "plan.mcap", Path(folder) / "scene.toml"
        write_plan(path, motion, cell, default_cell_file())
        prepared = prepare_trial(TrialSpecification(str(path), object=asked.object, seed=seed), cell)
        before, head, after = SCENE.read_text(encoding="utf-8").partition(f"[objects.{asked.object}]\n")
        first, _, rest = after.partition("mass = ")
        scene.write_text(f"{before}{head}{first}mass = {asked.mass}\n{rest.partition(chr(10))[2]}")
        simulated = simulated_cell(asked.object, 0.0, seed, scene=scene, parameters=load_plant_parameters())
        opened = simulated.as_cell("direct")
        try:
            result = run_trial(prepared, opened)
        finally:
            opened.close()
    return {"success": result.success, "reason": result.failure_reason}


class RandomPlans(Study):
    """The study. refusal: None where the plan was accepted; moved: whether there is a motion; success: None where it
    was not followed."""

    COLUMNS: ClassVar = {
        "asked": str, "refusal": str | None, "moved": bool, "success": bool | None, "reason": str | None,
    }  # fmt: skip
    unit = "plans"

    @staticmethod
    def run(out: Path, case: Case) -> Row:
        """Plan what a seed asks for, and follow it: always where it is accepted, of an even seed where not."""
        cell = load_cell_description(default_cell_file())
        asked = drawn(case.seed, cell)
        thing = replace(cell.objects[asked.object], mass=asked.mass)
        cell = replace(cell, objects={**cell.objects, asked.object: thing})
        row = {"asked": str(asked), "refusal": None, "moved": True, "success": None, "reason": None}
        try:
            motion = planned(cell, asked.object, asked.request)
        except PlanError as error:
            if isinstance(error, TooFast) and error.fastest is not None and not asked.keys:  # as the command does
                motion = planned(cell, asked.object, replace(asked.request, speed=error.fastest))
            else:
                row["refusal"] = str(error)
                try:
                    motion = planned(cell, asked.object, asked.request, checked=False)
                except PlanError:
                    return row | {"moved": False}
                if case.seed % 2:
                    return row
        return row | followed(motion, cell, asked, case.seed)

    def tables(self, rows: Sequence[Row]) -> tuple[list[Table], list[str]]:
        """Return the counts, and each plan that did not go as it should."""
        accepted = [row for row in rows if row["refusal"] is None]
        refused = [row for row in rows if row["refusal"] is not None]
        forced = [row for row in refused if row["success"] is not None]
        odd = [row for row in accepted if not row["success"]] + [row for row in forced if row["success"]]
        lines = []
        for what, plans in (("accepted", accepted), ("refused, followed by force", forced)):
            good = sum(row["success"] for row in plans)
            interval = binomtest(good, len(plans)).proportion_ci(method="wilson") if plans else None
            share = f"{interval.low:.1%} to {interval.high:.1%}" if interval else "-"
            lines.append([what, str(len(plans)), str(good), share])
        lines.append(["refused, no such motion", str(sum(not row["moved"] for row in refused)), "", ""])
        tables = [Table("Random plans", ("plan", "n", "succeed", "95 %"), lines)]
        if odd:
            headings = ("seed", "asked", "refused since", "failed since")
            words = [[row["id"], row["asked"], row["refusal"] or "", row["reason"] or ""] for row in odd]
            tables.append(Table("Accepted plans that failed, refused plans that succeed", headings, words))
        good = sum(row["success"] for row in accepted)
        return tables, [f"accepted: {good} of {len(accepted)} succeed"] * (good < WANTED * len(accepted))
