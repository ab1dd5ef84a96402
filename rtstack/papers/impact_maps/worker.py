"""What a worker does: identify a joint's friction, or run a trial and write its log. References: see reference.py."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hal.displacement import Displacement
from rtstack.control.parameters import ControlParameters, FrictionParameters
from rtstack.control.tick import ArmController
from rtstack.experiments.case_log import recorded_result
from rtstack.experiments.experiment import CellRun, Row
from rtstack.identification.procedure import Identification, sweep_log
from rtstack.impact_map import ReflectedInertia
from rtstack.log.reader import Log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.papers.conditions import LOGS, RECORDINGS
from rtstack.papers.demonstrations import CampaignBench, campaign_record, record_of
from rtstack.papers.impact_maps.feedback import feedback_signal
from rtstack.papers.impact_maps.plan import (
    DIRECTIONS,
    SWEEPS,
    Gains,
    JointFriction,
    Setting,
    ValidationConditions,
    ValidationTrial,
)
from rtstack.papers.impact_maps.prediction import MapKind, Prediction, read_prediction
from rtstack.papers.simulated_cell import FRICTION_DRAW, SMALLEST_FACTOR, BuiltCell, simulated_files
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters
from rtstack.trials.carry_out import carry_out
from rtstack.trials.review import log_columns
from rtstack.trials.specification import SweepSpecification, TrialSpecification
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
