"""What a worker does for a reference: plan it, run its parts with nothing in the way, feed forward what they tell."""

from dataclasses import replace

import numpy as np

from hal.files import replacing
from rtstack.experiments.seeds import seed_of
from rtstack.identification.along import COORDINATES, FADE_S, average, residual
from rtstack.papers.demonstrations import CELL, RECORDINGS, common_attachments
from rtstack.papers.impact_maps.cell import open_validation_cell
from rtstack.papers.impact_maps.feedback import AFTER_S
from rtstack.papers.impact_maps.plan import DIRECTIONS, FreeRuns, JointFriction, PlannedReference, Scenario
from rtstack.papers.impact_maps.prediction import predict
from rtstack.papers.impact_maps.worker import SWEEPS, ValidationBench, description_of, parameters_of
from rtstack.planning import GrabPlan, PlanError, PlannedMotion, plan_grab, plan_push
from rtstack.planning.file import write_plan
from rtstack.planning.free import PlanPhase, compensated, free_motion
from rtstack.trials.assembly import arm_controllers
from rtstack.trials.motion import run_motion
from rtstack.trials.record import frames, trial_metadata
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import FreeRunSpecification
from rtstack.trials.whole_run_log import WholeRunLog

NO_OBJECT = ""  # what a cell is opened with, as for a playback


def _planned(
    bench: ValidationBench, scenario: Scenario, thing: str, case: str, scale: float, compensate: bool
) -> PlannedMotion:
    """Return a plan. Raises PlanError."""
    description = description_of(bench)
    request = scenario.request(case, scale, compensate)
    if isinstance(request, GrabPlan):
        return plan_grab(description, thing, request)
    return plan_push(description, thing, request)


def identify_along(bench: ValidationBench, runs: FreeRuns, scenario: Scenario, count: int) -> str | None:
    """Make `count` runs along a part of a reference, their logs, and their average. Returns None, or in one line why
    it failed."""
    description = description_of(bench)
    conditions = replace(bench.nominal, joint_friction=JointFriction.IDENTIFIED)
    parameters = parameters_of(bench, conditions, scenario.gains, description)
    try:
        planned = _planned(bench, scenario, runs.object, runs.case_name, runs.scale, compensate=True)
        free = free_motion(planned, description, runs.part, parameters.control, AFTER_S + FADE_S)
    except PlanError as error:
        return str(error)
    arms, found = arm_controllers(description, parameters), []
    for run in range(count):
        seed = seed_of(bench.robot, runs.name, run)
        specification = FreeRunSpecification(runs.name, runs.part, run, bench.robot, seed)
        log = WholeRunLog(
            bench.out / SWEEPS / runs.log(run),
            {"trial": trial_metadata(specification, CELL, None)}, common_attachments(bench.cell_file),
            frames(description, NO_OBJECT),
        )  # fmt: skip
        cell = open_validation_cell(NO_OBJECT, seed, bench.robot, conditions)
        try:
            reason, columns = run_motion(free.plan, description, parameters, cell, RunContext(log))
        finally:
            cell.close()
        if reason is not None:
            return f"its run with nothing in the way ({runs.log(run)}): {reason}"
        found.append(residual(columns, free, arms))
    fade_s = FADE_S if runs.part is PlanPhase.POST else 0.0
    with replacing(bench.out / SWEEPS / runs.file) as partial, open(partial, "wb") as file:
        np.save(file, average(found, fade_s, free.plan.period_s))
    return None


def _along(bench: ValidationBench, reference: PlannedReference, planned: PlannedMotion) -> PlannedMotion:
    """Return the plan with what its free runs have left to compensate."""
    acceleration = np.zeros((2, planned.recording.points.shape[1], COORDINATES))
    for runs in reference.free_runs:
        part = np.load(bench.out / SWEEPS / runs.file)
        begin = planned.recording.impact if runs.part is PlanPhase.POST else 0
        acceleration[:, begin : begin + part.shape[1]] = part
    return compensated(planned, acceleration)


def plan_reference(bench: ValidationBench, reference: PlannedReference, scenario: Scenario) -> str | None:
    """Plan a reference, and write it beside its predictions. Returns None, or in one line why it is refused.

    What was identified along it has to be there.
    """
    description = description_of(bench)
    try:
        planned = _planned(
            bench, scenario, reference.object, reference.case_name, reference.scale, reference.compensate
        )
        prediction = predict(planned, DIRECTIONS[reference.motion])
    except PlanError as error:
        return str(error)
    planned = _along(bench, reference, planned)
    path = bench.out / RECORDINGS / reference.file
    prediction.write(path.with_suffix(".json"))
    write_plan(path, planned, description, bench.cell_file)
    return None
