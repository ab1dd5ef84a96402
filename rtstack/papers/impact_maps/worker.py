"""What a worker does: identify a joint's friction, plan a reference, or run a trial and write its log.

For a reference it runs its parts with nothing in the way, and feeds forward what they tell. (30)-(31) of Appendix A:
the mean feedback of free runs is what friction and gravity compensation leave along a reference. Feedback takes
2/sqrt(k) = 0.2 s to take up what changes; what it has not taken up yet accelerates the error, and counts too:
a_fr = a_fb + d/dt (v_d - v). So for six coordinates of the pad and the posture's joint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from hal.base.arrays import Array
from hal.base.files import replacing
from hal.displacement import Displacement
from hal.limits import CONTROL_PERIOD_S
from rtstack.control.impedance import factor_mass, task_inertia
from rtstack.control.parameters import ControlParameters, FrictionParameters
from rtstack.control.tick import ArmController
from rtstack.experiments.case_log import recorded_result
from rtstack.experiments.experiment import CellRun, Row
from rtstack.experiments.seeds import seed_of
from rtstack.identification.procedure import Identification, sweep_log
from rtstack.impact_map import ReflectedInertia
from rtstack.log.reader import Log, read_log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.papers.conditions import LOGS, RECORDINGS
from rtstack.papers.demonstrations import CampaignBench, campaign_record, record_of
from rtstack.papers.impact_maps.feedback import AFTER_S, feedback_signal
from rtstack.papers.impact_maps.plan import (
    DIRECTIONS,
    SWEEPS,
    FreeRuns,
    Gains,
    JointFriction,
    PlannedReference,
    Scenario,
    Setting,
    ValidationConditions,
    ValidationTrial,
)
from rtstack.papers.impact_maps.prediction import MapKind, Prediction, predict, read_prediction
from rtstack.papers.simulated_cell import FRICTION_DRAW, SMALLEST_FACTOR, BuiltCell, simulated_files
from rtstack.planning import GrabPlan, PlanError, PlannedMotion, PushPlan, plan_grab, plan_push
from rtstack.planning.file import write_plan
from rtstack.planning.free import FreeMotion, PlanPhase, compensated, free_motion
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters
from rtstack.trials.carry_out import carry_out
from rtstack.trials.move import PreparedMotion
from rtstack.trials.review import log_columns
from rtstack.trials.specification import FreeRunSpecification, SweepSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial
from sim_robot.scene import NO_OBJECT, PlacementScatter


def validation_cell(
    bench: "ValidationBench", object_name: str, seed: int, robot: int, conditions: ValidationConditions
) -> BuiltCell:
    """Return the simulated cell of a trial: arms of seed `robot`, all else of `seed`; object_name: empty for none."""
    nominal, parameters = simulated_files(bench.lab_file)
    draws = np.random.default_rng(np.random.SeedSequence([seed, FRICTION_DRAW])).standard_normal(2)
    pad, table = np.maximum(1.0 + conditions.friction_scatter * draws, SMALLEST_FACTOR).tolist()
    known = object_name or next(iter(nominal.objects))
    thing = nominal.find(known)
    if conditions.damping_ratio is not None:
        thing = replace(thing, damping_ratio=conditions.damping_ratio)
    scene = replace(
        nominal,
        pad=replace(nominal.pad, friction=conditions.pad_friction * pad),
        table=replace(nominal.table, friction=conditions.table_friction * table),
        placement_scatter=PlacementScatter(conditions.placement_mm, conditions.placement_yaw_deg),
        objects={**nominal.objects, known: thing},
    )
    joints = parameters.joints
    B_theta = tuple(conditions.B_theta_factor * inertia for inertia in joints.B_theta)
    parameters = replace(parameters, joints=replace(joints, B_theta=B_theta))
    if conditions.motor_inertia_scatter is not None:
        scatter = replace(parameters.scatter, motor_inertia=conditions.motor_inertia_scatter)
        parameters = replace(parameters, scatter=scatter)
    return BuiltCell(scene, parameters, object_name or NO_OBJECT, seed, arms_seed=robot)


def friction_file(robot: int) -> str:
    return f"friction.r{robot}.toml"


def sweep_file(robot: int, asked: SweepSpecification) -> str:
    return f"r{robot}.{sweep_log(asked)}"


PREDICTED = {(which, kind): f"{which}_{kind}_m_s" for which in MapKind for kind in ReflectedInertia}
# What a trial gives to the fit, m/s: velocities after the impact as planned and as predicted by each map with each
# inertia, net feedback (29), its mean over the last swing, how much it still swings, and the pads' lowest velocity
# after the impact. complete: whether the trial lasted for all of (29)'s window.
MEASURED: dict[str, type] = dict.fromkeys(
    ["planned_m_s", *PREDICTED.values(), "net_feedback_m_s", "net_over_swing_m_s", "swing_m_s", "lowest_m_s"], float
) | {"complete": bool}


@dataclass(frozen=True, slots=True)
class ValidationBench(CampaignBench):
    """nominal: the identification's conditions. on_arms: of a cell, with its joint friction. lab_file: see Bench."""

    nominal: ValidationConditions
    on_arms: bool = False
    lab_file: Path | None = None


@lru_cache(maxsize=1)
def _identification(bench: ValidationBench) -> Identification:
    return Identification(bench.description)


def identify(bench: ValidationBench, robot: int, asked: SweepSpecification) -> str | None:
    """Make one run of a robot's identification, and its log. Returns None, or in one line why it failed."""
    log = bench.log(bench.out / SWEEPS / sweep_file(robot, asked), asked, bench.description.gains.law_inertia)
    prepared = _identification(bench).prepared(asked)
    built = validation_cell(bench, asked.object, prepared.noise, robot, bench.nominal)
    return carry_out(prepared, built.host(bench.cell, log)).failure_reason


def parameters_of(
    bench: ValidationBench, conditions: ValidationConditions, gains: Gains, description: CellDescription, robot: int
) -> Parameters:
    """Return the controller's numbers: the paper's tasks and interim mode, friction as the conditions have it."""
    if conditions.joint_friction is not JointFriction.IDENTIFIED:
        description = replace(description, joint_friction=None)
    elif not bench.on_arms:
        description = replace(description, joint_friction=bench.out / friction_file(robot))
    parameters = cell_parameters(description)
    if conditions.joint_friction is JointFriction.NONE:
        none = FrictionParameters(scale=0.0)
        parameters = replace(parameters, friction=(none, none))
    after = None if gains.k_theta_after is None else np.repeat([gains.k_p, gains.k_theta_after], 3)
    control = ControlParameters(
        stiffness=np.repeat([gains.k_p, gains.k_theta], 3), stiffness_after_impact=after, posture_gain=gains.k_q,
        acceleration_tasks=True, blend_interim=False,
    )  # fmt: skip
    return replace(parameters, control=control)


@lru_cache(maxsize=64)
def _prepared(bench: ValidationBench, setting: Setting) -> tuple[PreparedTrial, Prediction]:
    description, reference = bench.description, setting.reference
    path = bench.out / RECORDINGS / reference.file
    parameters = parameters_of(bench, setting.conditions, setting.gains, description, reference.robot)
    prepared = prepare_trial(TrialSpecification(str(path), object=reference.object), description, parameters)
    return prepared, read_prediction(path.with_suffix(".json"))


@lru_cache(maxsize=1)
def _models(bench: ValidationBench) -> tuple[ArmController, ...]:
    description = bench.description
    return arm_controllers(description, cell_parameters(description))


def run(bench: ValidationBench, trial: ValidationTrial, setting: Setting) -> list[Row]:
    prepared, prediction = _prepared(bench, setting)
    specification = TrialSpecification(f"{RECORDINGS}/{setting.reference.file}", object=trial.object, seed=trial.seed)
    prepared = replace(prepared, specification=specification)
    log = bench.log(
        bench.out / LOGS / f"{trial.id}.mcap", specification, prepared.parameters.inertia.law_inertia,
        reference=prepared.reference, campaign=campaign_record(trial, bench.digest),
    )  # fmt: skip
    built = validation_cell(bench, trial.object, trial.seed, trial.robot, setting.conditions)
    result, columns = bench.run(prepared, built, log)
    return [_row(bench, trial, prediction, result.as_dict(), columns)]


def on_arms(bench: ValidationBench, trial: ValidationTrial, setting: Setting) -> CellRun:
    """Return a trial as a run on a cell's arms, from the object's nominal place."""
    prepared, _ = _prepared(bench, setting)
    prepared = replace(prepared, specification=replace(prepared.specification, seed=trial.seed))
    return CellRun(prepared, bench.out / LOGS / f"{trial.id}.mcap", record_of(trial), Displacement())


def row_of_log(
    bench: ValidationBench, trial: ValidationTrial, setting: Setting, log: Log, columns: Mapping[str, Any]
) -> Row:
    prediction = read_prediction((bench.out / RECORDINGS / setting.reference.file).with_suffix(".json"))
    return _row(bench, trial, prediction, recorded_result(log, columns), log_columns(log))


def _row(
    bench: ValidationBench, trial: ValidationTrial, prediction: Prediction, result: Mapping[str, Any], columns: Columns
) -> Row:
    signal = feedback_signal(columns, result["nominal_impact_time_s"], _models(bench), DIRECTIONS[trial.motion])
    predicted = [prediction.by_map[which][kind] for which, kind in PREDICTED]
    measured = (
        prediction.planned, *predicted, signal.net, signal.net_over_swing, signal.swing, signal.lowest, signal.complete,
    )  # fmt: skip
    values = {**asdict(trial), **result, **dict(zip(MEASURED, measured, strict=True))}
    return values | {"id": trial.id, "motion": str(trial.motion), "log": f"{LOGS}/{trial.id}.mcap"}


WINDOW = 101  # ticks over which what is left is smoothed, by cubics: friction along a path changes with the path
FADE_S = 0.1  # at the end of what was run
COORDINATES = 7  # of the pad, six, and the posture's joint


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
            built = validation_cell(bench, "", prepared.noise, runs.robot, bench.nominal)
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
