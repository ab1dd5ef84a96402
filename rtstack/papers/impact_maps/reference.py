"""What a worker does for a reference: plan it, run its parts with nothing in the way, feed forward what they tell.

(30)-(31) of Appendix A: the mean feedback of free runs is what friction and gravity compensation leave along a
reference. Feedback takes 2/sqrt(k) = 0.2 s to take up what changes; what it has not taken up yet accelerates the
error, and counts too: a_fr = a_fb + d/dt (v_d - v). So for six coordinates of the pad and the posture's joint.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.signal import savgol_filter

from hal.base.arrays import Array
from hal.base.files import replacing
from hal.limits import CONTROL_PERIOD_S
from rtstack.control.impedance import factor_mass, task_inertia
from rtstack.control.tick import ArmController
from rtstack.experiments.experiment import CellRun
from rtstack.experiments.seeds import seed_of
from rtstack.log.reader import read_log
from rtstack.loop.history import Columns
from rtstack.papers.conditions import RECORDINGS
from rtstack.papers.impact_maps.feedback import AFTER_S
from rtstack.papers.impact_maps.plan import (
    DIRECTIONS,
    SWEEPS,
    FreeRuns,
    Gains,
    JointFriction,
    PlannedReference,
    Scenario,
)
from rtstack.papers.impact_maps.prediction import predict
from rtstack.papers.impact_maps.worker import ValidationBench, parameters_of, validation_cell
from rtstack.planning import GrabPlan, PlanError, PlannedMotion, PushPlan, plan_grab, plan_push
from rtstack.planning.file import write_plan
from rtstack.planning.free import FreeMotion, PlanPhase, compensated, free_motion
from rtstack.trials.assembly import arm_controllers
from rtstack.trials.carry_out import carry_out
from rtstack.trials.motion import PreparedMotion
from rtstack.trials.review import log_columns
from rtstack.trials.specification import FreeRunSpecification

WINDOW = 101  # ticks over which what is left is smoothed, by cubics: friction along a path changes with the path
FADE_S = 0.1  # at the end of what was run
COORDINATES = 7  # of the pad, six, and the posture's joint
NO_OBJECT = ""  # what a cell is opened with, as for a playback


@lru_cache(maxsize=4)  # the robots' turns follow one another
def _planned(bench: ValidationBench, thing: str, request: GrabPlan | PushPlan) -> PlannedMotion:
    description = bench.description
    if isinstance(request, GrabPlan):
        return plan_grab(description, thing, request)
    return plan_push(description, thing, request)


@lru_cache(maxsize=2)  # the runs along a part follow one another
def _free_run(
    bench: ValidationBench, runs: FreeRuns, gains: Gains, request: GrabPlan | PushPlan
) -> tuple[FreeMotion, PreparedMotion]:
    """Return the motion along a part of a reference, and the first run of it. Raises PlanError."""
    description = bench.description
    conditions = replace(bench.nominal, joint_friction=JointFriction.IDENTIFIED)
    parameters = parameters_of(bench, conditions, gains, description, runs.robot)
    planned = _planned(bench, runs.object, request)
    free = free_motion(planned, description, runs.part, parameters.control, AFTER_S + FADE_S)
    seed = seed_of(runs.robot, runs.name, 0)
    specification = FreeRunSpecification(runs.name, runs.part, 0, runs.robot, seed)
    return free, PreparedMotion(specification, description, free.plan, parameters, seed, True)


def _run_of(bench: ValidationBench, runs: FreeRuns, scenario: Scenario, run: int) -> tuple[FreeMotion, PreparedMotion]:
    """Return the motion along a part of a reference, and a run of it. Raises PlanError."""
    request = scenario.request(runs.case_name, runs.scale, kind=runs.map)
    free, first = _free_run(bench, runs, scenario.gains, request)
    seed = seed_of(runs.robot, runs.name, run)
    return free, replace(first, specification=replace(first.specification, run=run, seed=seed), noise=seed)


def free_run_on_arms(bench: ValidationBench, runs: FreeRuns, scenario: Scenario, run: int) -> CellRun:
    """Return a run along a part of a reference as one on a cell's arms. Raises PlanError."""
    _, prepared = _run_of(bench, runs, scenario, run)
    return CellRun(prepared, bench.out / SWEEPS / runs.log(run), clear=True)


def identify_along(bench: ValidationBench, runs: FreeRuns, scenario: Scenario, count: int) -> str | None:
    """Make `count` runs along a part of a reference, or take those of arms; average them. Returns why it failed."""
    found: list[Array] = []
    for run in range(count):
        try:
            free, prepared = _run_of(bench, runs, scenario, run)
        except PlanError as error:
            return str(error)
        path, arms = bench.out / SWEEPS / runs.log(run), arm_controllers(bench.description, prepared.parameters)
        if bench.on_arms:
            columns = log_columns(read_log(path))
        else:
            log = bench.log(path, prepared.specification, prepared.parameters.inertia.law_inertia)
            built = validation_cell(bench, NO_OBJECT, prepared.noise, runs.robot, bench.nominal)
            result = carry_out(prepared, built.host(bench.cell, log))
            if not result.success:
                return f"its run with nothing in the way ({runs.log(run)}): {result.failure_reason}"
            columns = result.columns
        found.append(residual(columns, free, arms))
    fade_s = FADE_S if runs.part is PlanPhase.POST else 0.0
    with replacing(bench.out / SWEEPS / runs.file) as unfinished, open(unfinished, "wb") as file:
        np.save(file, average(found, fade_s, CONTROL_PERIOD_S))
    return None


def plan_reference(bench: ValidationBench, reference: PlannedReference, scenario: Scenario) -> str | None:
    """Plan a reference whose free runs are there; write it and its predictions. Returns None, or why it is refused."""
    try:
        request = scenario.request(reference.case_name, reference.scale, reference.compensate, reference.map)
        planned = _planned(bench, reference.object, request)
        prediction = predict(planned, DIRECTIONS[reference.motion])
    except PlanError as error:
        return str(error)
    left = np.zeros((2, planned.recording.points.shape[1], COORDINATES))  # for feedforward to compensate
    for runs in reference.free_runs:
        part = np.load(bench.out / SWEEPS / runs.file)
        begin = planned.recording.impact if runs.part is PlanPhase.POST else 0
        left[:, begin : begin + part.shape[1]] = part
    path = bench.out / RECORDINGS / reference.file
    prediction.write(path.with_suffix(".json"))
    write_plan(path, compensated(planned, left), bench.description, bench.cell_file)
    return None


def residual(columns: Columns, free: FreeMotion, arms: Sequence[ArmController]) -> Array:
    """Return what feedback would have had to add, (arms, end - begin, 7) m/s^2, rad/s^2; arms: for their models."""
    joint, period_s = arms[0].parameters.posture_joint, free.plan.period_s
    n = min(columns.arm.shape[1], free.plan.ticks)
    found = np.empty((len(arms), free.end - free.begin, COORDINATES))
    for side, arm in enumerate(arms):
        samples, control, points = columns.arm[side][:n], columns.control[side][:n], free.plan.ante[side][:n]
        feedback, lag = np.empty((n, COORDINATES)), np.empty((n, COORDINATES))
        wrench = control["wrench_desired"] - control["wrench_ff"]
        for i in range(n):
            work = arm.observed_at(samples["q"][i], samples["dq"][i])
            factor_mass(work)
            task_inertia(work)
            feedback[i, :6] = work["Lambda_inverse"] @ wrench[i]
            lag[i, :6] = control["twist_ref"][i] - work["twist"]
        feedback[:, 6] = control["beta"] - points["beta"]
        lag[:, 6] = points["dxi"] - samples["dq"][:, joint]
        taken_up: Array = np.asarray(savgol_filter(feedback, WINDOW, 3, axis=0))
        left: Array = np.asarray(savgol_filter(lag, WINDOW, 3, deriv=1, delta=period_s, axis=0))
        found[side] = (taken_up + left)[free.begin : free.end]
    return found


def average(residuals: Sequence[Array], fade_s: float, period_s: float) -> Array:
    """Return (31), the mean over runs of residuals (arms, n, 7), which ends within the last fade_s, not at once."""
    mean = np.mean(residuals, axis=0)
    n = mean.shape[1]
    fade = np.clip((n - np.arange(n)) * period_s / fade_s, 0.0, 1.0) if fade_s > 0.0 else np.ones(n)
    return mean * fade[None, :, None]
