"""What a worker does: identify a joint's friction, or run a trial and write its log. References: see reference.py."""

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from rtstack.control.parameters import ControlParameters, FrictionParameters
from rtstack.control.tick import ArmController
from rtstack.experiments.experiment import Row
from rtstack.identification.procedure import Identification, SweepRun
from rtstack.impact_map import ReflectedInertia
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.papers.demonstrations import CELL, LOGS, RECORDINGS, common_attachments
from rtstack.papers.impact_maps.cell import open_validation_cell
from rtstack.papers.impact_maps.feedback import feedback_signal
from rtstack.papers.impact_maps.plan import (
    DIRECTIONS,
    Conditions,
    Gains,
    JointFriction,
    PlannedReference,
    ValidationTrial,
)
from rtstack.papers.impact_maps.prediction import Prediction, read_prediction
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters
from rtstack.trials.record import frames, trial_metadata
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial
from rtstack.trials.whole_run_log import WholeRunLog

SWEEPS = "identification"
FRICTION = "friction.toml"


@dataclass(frozen=True, slots=True)
class Measured:
    """What a trial gives to the fit, m/s: velocities after the impact as planned and as predicted, net feedback (29),
    its mean over the last swing, and how much it still swings. complete: whether the trial lasted for all of (29)'s
    window."""

    planned_m_s: float
    predicted_B_theta_m_s: float
    predicted_B_m_s: float
    predicted_none_m_s: float
    net_feedback_m_s: float
    net_over_swing_m_s: float
    swing_m_s: float
    complete: bool


@dataclass(frozen=True, slots=True)
class ValidationBench:
    """What all trials of a campaign have in common, as it is sent to the workers. robot: seed of the arms; nominal: the
    conditions of the identification; digest: the campaign's, for the logs. Paths are absolute."""

    out: Path
    cell_file: Path
    robot: int
    nominal: Conditions
    digest: str


@lru_cache(maxsize=4)
def description_of(bench: ValidationBench) -> CellDescription:
    """Return the cell's description."""
    return load_cell_description(bench.cell_file)


@lru_cache(maxsize=1)
def _identification(bench: ValidationBench) -> Identification:
    return Identification(description_of(bench))


def identify(bench: ValidationBench, run: SweepRun) -> str | None:
    """Make one run of the identification, and its log. Returns None, or in one line why it failed."""
    specification = run.specification
    identification = _identification(bench)
    log = WholeRunLog(
        bench.out / SWEEPS / run.file,
        {"trial": trial_metadata(specification, CELL, None)}, common_attachments(bench.cell_file),
        frames(description_of(bench), specification.object),
    )  # fmt: skip
    noise = 1000 * specification.run + specification.joint
    cell = open_validation_cell(specification.object, noise, bench.robot, bench.nominal)
    try:
        return identification.run(run, cell, RunContext(log))
    finally:
        cell.close()


def parameters_of(
    bench: ValidationBench, conditions: Conditions, gains: Gains, description: CellDescription
) -> Parameters:
    """Return the controller's numbers: the paper's tasks and interim mode, friction as the conditions have it."""
    if conditions.joint_friction is JointFriction.IDENTIFIED:
        description = replace(description, joint_friction=bench.out / FRICTION)
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


@lru_cache(maxsize=16)
def _prepared(
    bench: ValidationBench, reference: PlannedReference, gains: Gains, conditions: Conditions
) -> tuple[PreparedTrial, Prediction]:
    description = description_of(bench)
    path = bench.out / RECORDINGS / reference.file
    parameters = parameters_of(bench, conditions, gains, description)
    prepared = prepare_trial(TrialSpecification(str(path), object=reference.object), description, parameters)
    return prepared, read_prediction(path.with_suffix(".json"))


@lru_cache(maxsize=1)
def _models(bench: ValidationBench) -> tuple[ArmController, ArmController]:
    description = description_of(bench)
    return arm_controllers(description, cell_parameters(description))


def run(
    bench: ValidationBench, trial: ValidationTrial, reference: PlannedReference, gains: Gains, conditions: Conditions
) -> list[Row]:
    """Run a trial and write its log. Returns the row of the results' table."""
    prepared, prediction = _prepared(bench, reference, gains, conditions)
    specification = TrialSpecification(f"{RECORDINGS}/{reference.file}", object=trial.object, seed=trial.seed)
    prepared = replace(prepared, specification=specification)
    path = bench.out / LOGS / f"{trial.id}.mcap"
    campaign = {key: str(value) for key, value in asdict(trial).items()} | {"id": trial.id, "digest": bench.digest}
    metadata = {"trial": trial_metadata(specification, CELL, prepared.reference), "campaign": campaign}
    log = WholeRunLog(
        path, metadata, common_attachments(bench.cell_file),
        frames(prepared.description, trial.object),
    )  # fmt: skip
    cell = open_validation_cell(trial.object, trial.seed, bench.robot, conditions)
    try:
        result = run_trial(prepared, cell, RunContext(log))
    finally:
        cell.close()
    if log.columns is None or not path.exists():
        raise OSError(result.failure_reason)
    signal = feedback_signal(log.columns, result.nominal_impact_time_s, _models(bench), DIRECTIONS[trial.motion])
    by = prediction.by_inertia
    measured = Measured(
        prediction.planned, by[ReflectedInertia.B_THETA], by[ReflectedInertia.B], by[ReflectedInertia.NONE],
        signal.net, signal.net_over_swing, signal.swing, signal.complete,
    )  # fmt: skip
    values = {**asdict(trial), **result.as_dict(), **asdict(measured)}
    return [values | {"id": trial.id, "motion": str(trial.motion), "log": f"{LOGS}/{trial.id}.mcap"}]
