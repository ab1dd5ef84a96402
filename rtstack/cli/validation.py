"""`rtstack campaign` for the validation of impact maps: everything is checked before the folder is made."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from hal.cell import Cell
from rtstack.campaign.plan import PlanFile
from rtstack.campaign.store import Store, check_folder, columns_of
from rtstack.campaign.worker import digests
from rtstack.cli.campaign_cell import FRICTION_DRAW, SMALLEST_FACTOR, plant_files, simulated_files
from rtstack.cli.cells import load_description
from rtstack.cli.invocation import crew, end, run_counted
from rtstack.impact_validation.plan import Conditions, ValidationPlan, ValidationTrial, load_validation_plan
from rtstack.impact_validation.worker import Measured, ValidationBench
from rtstack.model.cell_description import CellDescription
from rtstack.trials.object import check_object
from rtstack.trials.result import TrialResult
from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.scene import PlacementScatter

COLUMNS = columns_of(ValidationTrial, TrialResult, Measured)


def prepare(
    file: PlanFile, out: Path, quick: bool, resume: bool
) -> tuple[ValidationPlan, ValidationBench, CellDescription]:
    """Check everything before the folder is made. Raises ConfigurationError or TrialError."""
    plan = load_validation_plan(file.path, quick)
    description, cell_file = load_description(None)
    for thing in plan.objects:
        check_object(thing, description)
    sources = [file.path, cell_file, *plant_files()]
    plan = plan.sealed([path.read_bytes() for path in sources])
    check_folder(out, plan, resume, COLUMNS)
    nominal = next(iter(plan.conditions.values()))
    bench = ValidationBench(out, cell_file, open_validation_cell, plan.robot, nominal, plan.digest, digests(sources))
    return plan, bench, description


def run_all(
    plan: ValidationPlan, bench: ValidationBench, description: CellDescription, file: PlanFile, workers: int,
    scheduler: str | None,
) -> None:  # fmt: skip
    """Run what is missing, and write the report."""
    from rtstack.campaign.crew import slots
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.impact_validation.report import write_report
    from rtstack.impact_validation.runner import ValidationRunner

    with crew(workers, scheduler) as client:
        at_once = slots(client)
        bench.out.mkdir(exist_ok=True)
        with Store(bench.out, COLUMNS) as store:
            store.claim(plan, file)
            with campaign_progress() as progress:
                runner = ValidationRunner(plan, bench, store, client, progress, description)
                tally = run_counted(runner, store, at_once)
            page = write_report(store, plan, file, description, runner.refused)
    print(f"{tally.trials} trials with {at_once} workers")
    for reference, reason in runner.refused.items():
        print(f"rtstack: the plan {reference.file} is refused, its trials are left out: {reason}", file=sys.stderr)
    end(page, tally.failures, spoilt=bool(runner.refused))


def open_validation_cell(object_name: str, seed: int, robot: int, conditions: Conditions) -> Cell:
    """Open the simulated cell of a trial: the arms of seed `robot`, everything else of `seed`. Raises HardwareError.

    object_name: empty for a cell without an object.
    """
    nominal, parameters = simulated_files()
    draws = np.random.default_rng(np.random.SeedSequence([seed, FRICTION_DRAW])).standard_normal(2)
    pad, table = np.maximum(1.0 + conditions.friction_scatter * draws, SMALLEST_FACTOR).tolist()
    empty = not object_name
    object_name = object_name or next(iter(nominal.objects))
    thing = nominal.find(object_name)
    if conditions.damping_ratio is not None:
        thing = replace(thing, damping_ratio=conditions.damping_ratio)
    scene = replace(
        nominal,
        pad=replace(nominal.pad, friction=conditions.pad_friction * pad),
        table=replace(nominal.table, friction=conditions.table_friction * table),
        placement_scatter=PlacementScatter(conditions.placement_mm, conditions.placement_yaw_deg),
        objects={**nominal.objects, object_name: thing},
    )
    joints = parameters.joints
    B_theta = tuple(conditions.B_theta_factor * inertia for inertia in joints.B_theta)
    parameters = replace(parameters, joints=replace(joints, B_theta=B_theta))
    plant = Plant(scene, parameters, object_name, 0.0, seed, robot)
    return SimulatedCell(plant, scene, parameters, seed, empty=empty).as_cell("direct")
