"""Random plans: of those that are accepted, how many succeed; of those that are refused, how many would have.

    .venv/bin/python -m tests.programs.random_plans [--plans 100] [--jobs 2] [--folder .random-plans] [--first-seed N]

Each seed draws a motion (one of five is a push), an object of the cell, its mass (as the cell says, or, of two out of
five, any of MASSES: the simulated object weighs the same), the pads' height on it, and speed and rise within what a
plan may be asked for; one of five takes the plan's defaults, as `rtstack plan --object` does. A plan that is accepted
is followed once, on the plant in this process, with arms and noise of the same seed. Of the refused ones every second
is followed too, as it would have been: by the function below the checks (grab_motion, push_motion). It has no way
around the safety judge or the robot's reflexes, which stay as they are; a plan of which there is no motion (no
configuration, an object that does not rise) cannot be tried.

The constants of the checks (rtstack/planning/impact_loads.py, feasibility.py) were fitted on seeds 71000 to 71181,
with ranges like these; judged is by seeds from FIRST_SEED on.

Goes on where it was ended. Exit status 1 where fewer than 98 % of the accepted plans succeed; 130 after Ctrl-C.
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal

import numpy as np
from rich.progress import track
from scipy.stats import binomtest

from rtstack.cells import default_cell_file
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.planning import GrabPlan, PlanError, PlannedMotion, PushPlan, TooFast, plan_grab, plan_push
from rtstack.planning.file import write_plan
from rtstack.planning.grab import grab_motion
from rtstack.planning.push import push_motion
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import simulated_cell
from sim_robot.plant_parameters import load_plant_parameters

FIRST_SEED = 72000
WANTED = 0.98
MASSES = (0.3, 5.0)  # kg
SPEEDS, RISES = (0.05, 0.8), (0.1, 0.5)  # m/s
PUSHES, OTHER_MASSES, DEFAULTS = 0.2, 0.4, 0.2  # shares
EDGE_M = 1e-3  # of the room that the pads have on the object's face
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a seed asks for. speed, rise and height are None where the plan's defaults are taken."""

    seed: int
    object: str
    mass: float
    push: bool
    speed: float | None
    rise: float | None
    height: float | None

    @property
    def request(self) -> GrabPlan | PushPlan:
        """The plan."""
        keys = ("speed", "height") if self.push else ("speed", "rise", "height")
        asked = {key: getattr(self, key) for key in keys if getattr(self, key) is not None}
        return PushPlan(**asked) if self.push else GrabPlan(**asked)


@dataclass(frozen=True, slots=True)
class Tried:
    """What became of a plan. refusal: None where it was accepted; moved: whether there is a motion; success: None where
    it was not followed. speed: m/s, the plan's."""

    seed: int
    refusal: str | None
    moved: bool
    speed: float
    success: bool | None
    reason: str | None
    slower: float | None = None


def drawn(seed: int, description: CellDescription) -> Drawn:
    """Return what a seed asks for, in mm, cm/s and tens of grams as a person would."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(description.objects)))
    thing = description.objects[name]
    mass = round(float(rng.uniform(*MASSES)), 2) if rng.random() < OTHER_MASSES else thing.mass
    push, default = bool(rng.random() < PUSHES), bool(rng.random() < DEFAULTS)
    room = (thing.size[2] - description.pad.size[1]) / 2 - EDGE_M
    lowest = max(-room, 0.005 - room)
    height = round(float(rng.uniform(lowest, room)), 3)
    speed, rise = (round(float(rng.uniform(*bounds)), 2) for bounds in (SPEEDS, RISES))
    if default:
        return Drawn(seed, name, mass, push, None, None, None)
    return Drawn(seed, name, mass, push, speed, None if push else rise, height)


def run(seed: int) -> Tried:
    """Plan what a seed asks for, and follow it: always where it is accepted, of an even seed where it is refused."""
    cell = load_cell_description(default_cell_file())
    asked = drawn(seed, cell)
    thing = replace(cell.objects[asked.object], mass=asked.mass)
    cell = replace(cell, objects={**cell.objects, asked.object: thing})
    request, refusal, slower = asked.request, None, None
    try:
        planned = _planned(cell, asked.object, request)
    except PlanError as error:
        refusal = str(error)
        slower = error.fastest if isinstance(error, TooFast) else None
        if slower is not None and asked.speed is None:  # as the command does, which was not asked for a speed
            request = replace(request, speed=slower)
            refusal, slower, planned = None, None, _planned(cell, asked.object, request)
        else:
            try:
                planned = _unchecked(cell, asked.object, request)
            except PlanError:
                return Tried(seed, refusal, False, request.speed, None, None)
    if refusal is not None and seed % 2:
        return Tried(seed, refusal, True, request.speed, None, None, slower)
    success, reason = _followed(planned, cell, asked)
    return Tried(seed, refusal, True, request.speed, success, reason, slower)


def _planned(cell: CellDescription, thing: str, request: GrabPlan | PushPlan) -> PlannedMotion:
    if isinstance(request, GrabPlan):
        return plan_grab(cell, thing, request)
    return plan_push(cell, thing, request)


def _unchecked(cell: CellDescription, thing: str, request: GrabPlan | PushPlan) -> PlannedMotion:
    if isinstance(request, GrabPlan):
        return grab_motion(cell, thing, request)
    return push_motion(cell, thing, request)


def _followed(planned: PlannedMotion, cell: CellDescription, asked: Drawn) -> tuple[bool, str | None]:
    """Write the plan, read it back and follow it on the plant in this process, whose object has the mass asked for."""
    with tempfile.TemporaryDirectory() as folder:
        path, scene = Path(folder) / "plan.mcap", Path(folder) / "scene.toml"
        write_plan(path, planned, cell, default_cell_file())
        prepared = prepare_trial(TrialSpecification(str(path), object=asked.object, seed=asked.seed), cell)
        scene.write_text(_scene(asked))
        simulated = simulated_cell(asked.object, 0.0, asked.seed, scene=scene, parameters=load_plant_parameters())
        opened = simulated.as_cell("direct")
        try:
            result = run_trial(prepared, opened)
        finally:
            opened.close()
    return result.success, result.failure_reason


def _scene(asked: Drawn) -> str:
    """Return the simulated cell's own scene, where the object weighs what was asked for."""
    text = (ROOT / "sim_robot" / "scenes" / "grab.toml").read_text(encoding="utf-8")
    before, head, after = text.partition(f"[objects.{asked.object}]\n")
    lines = after.split("\n")
    first = next(k for k, line in enumerate(lines) if line.startswith("mass = "))
    lines[first] = f"mass = {asked.mass}"
    return before + head + "\n".join(lines)


def report(tried: list[Tried]) -> int:
    """Print each plan that did not go as it should, and the counts; return the exit status."""
    cell = load_cell_description(default_cell_file())
    accepted = [plan for plan in tried if plan.refusal is None]
    refused = [plan for plan in tried if plan.refusal is not None]
    forced = [plan for plan in refused if plan.success is not None]
    for title, plans in (
        ("accepted, and failed", [plan for plan in accepted if not plan.success]),
        ("refused; it would have succeeded", [plan for plan in forced if plan.success]),
        ("refused; it would have failed", [plan for plan in forced if not plan.success]),
        ("refused, not tried", [plan for plan in refused if plan.success is None]),
    ):
        for plan in plans:
            asked = drawn(plan.seed, cell)
            where = "defaults" if asked.height is None else f"rise {asked.rise}, height {asked.height}"
            motion = "push" if asked.push else "grab"
            print(f"{plan.seed} {title}: {motion} of {asked.object}, {asked.mass:g} kg, {plan.speed:.2f} m/s, {where}")
            for line in filter(None, (plan.refusal, plan.reason)):
                print(f"      {line}")
    print(f"\nplans: {len(tried)}, accepted {len(accepted)}, refused {len(refused)}, of which "
          f"{sum(not plan.moved for plan in refused)} have no motion that could be tried")  # fmt: skip
    for what, plans in (("accepted plans that succeed", accepted), ("refused plans that succeed by force", forced)):
        good = sum(bool(plan.success) for plan in plans)
        if plans:
            interval = binomtest(good, len(plans)).proportion_ci(method="wilson")
            print(f"{what}: {good} of {len(plans)} ({good / len(plans):.1%}; 95 % within {interval.low:.1%} and "
                  f"{interval.high:.1%})")  # fmt: skip
    return 0 if sum(bool(plan.success) for plan in accepted) >= WANTED * len(accepted) else 1


def main() -> int:
    """Run what is missing; return the exit status."""
    arguments = argparse.ArgumentParser(description="Random plans, accepted and refused, followed in simulation.")
    arguments.add_argument("--plans", type=int, default=100)
    arguments.add_argument("--first-seed", type=int, default=FIRST_SEED)
    arguments.add_argument("--folder", type=Path, default=ROOT / ".random-plans")
    arguments.add_argument("--jobs", type=int, default=os.cpu_count())
    options = arguments.parse_args()
    options.folder.mkdir(exist_ok=True)
    (options.folder / ".gitignore").write_text("*\n")
    results = options.folder / "results.jsonl"
    known = [Tried(**json.loads(line)) for line in results.read_text().splitlines()] if results.exists() else []
    wanted = range(options.first_seed, options.first_seed + options.plans)
    missing = sorted(set(wanted) - {plan.seed for plan in known})
    try:
        with get_context("spawn").Pool(options.jobs, signal, (SIGINT, SIG_IGN)) as processes:
            for plan in track(processes.imap_unordered(run, missing), "plans", len(missing)):
                known.append(plan)
                with results.open("a") as file:
                    file.write(json.dumps(asdict(plan)) + "\n")
    except KeyboardInterrupt:
        print("ended; the next run goes on from here")
        return 130
    return report(sorted((plan for plan in known if plan.seed in wanted), key=lambda plan: plan.seed))


if __name__ == "__main__":
    sys.exit(main())
