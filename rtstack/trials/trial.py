"""Runs a trial on a cell: follow a reference through the impact, and score it. One process, one MCAP file."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from hal.cell import Cell
from rtstack.control.watch import FREE_AFTER_S, UNTIL_BEFORE_S
from rtstack.loop.session import SessionOutcome, SessionPlan
from rtstack.model.cell_description import NO_TRACKER, CellDescription, base_poses
from rtstack.monitor.pair import PairParameters
from rtstack.monitor.records import Verdict
from rtstack.references.motion import Motion
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.references.spreading import ExtendedReference
from rtstack.safety.limits import PairLimits
from rtstack.samples import Level, Mode, Reaction
from rtstack.trials.assembly import Parameters, Watched, arm_controllers, cell_parameters
from rtstack.trials.controllers import controller_factory
from rtstack.trials.errors import TrialError
from rtstack.trials.load import settle_load
from rtstack.trials.monitoring import tuning_file, tuning_folder, tuning_in, tuning_of
from rtstack.trials.object import check_object
from rtstack.trials.result import TrialResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.run_observer import RunEvent
from rtstack.trials.scoring import Score, SuccessCriterion, failure_reason, score
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import limits_of_arms


@dataclass(frozen=True, slots=True)
class PreparedTrial:
    """A trial whose reference was read and checked: nothing is open and nothing written yet.

    monitor: None where the object, or the plan, has no tuning. tuned_by: the user's own file that it is from.
    """

    specification: TrialSpecification
    description: CellDescription
    parameters: Parameters
    reference: ExtendedReference
    limits: PairLimits
    monitor: PairParameters | None = None
    tuned_by: Path | None = None

    @property
    def unwatched(self) -> str | None:
        """Why the impact is not monitored, and what to do about it; None where the monitor does."""
        if self.reference.motion is not Motion.GRAB:
            return f"it follows a {self.reference.motion}, and the monitor judges what both arms do to one object"
        if self.reference.impact is None:
            return "its plan does not say what the pads are to exert: plan it again with this version"
        if self.monitor is not None:
            return None
        if self.reference.planned:
            return "its plan has no monitor: make one with it, by rtstack plan --watch RUNS"
        name = self.specification.object
        return (
            f"the monitor is not tuned for {name}; make a tuning of its good runs: "
            f"rtstack tune-monitor LOG.mcap... --out {tuning_folder() / f'{name}.toml'}"
        )


def prepare_trial(
    specification: TrialSpecification,
    description: CellDescription,
    parameters: Parameters | None = None,
    monitor: PairParameters | None = None,
) -> PreparedTrial:
    """Read and check what a trial needs. monitor: by default what the plan brings, or the object's tuning.

    Raises TrialError with one line, also for a reaction that nothing could start.
    """
    parameters = parameters or cell_parameters(description)
    check_object(specification.object, description)
    controller_factory(specification.controller)
    limits = limits_of_arms(description, specification.safety)
    try:
        reference = load_reference(
            Path(specification.reference), arm_controllers(description, parameters), parameters.detector
        )
    except ReferenceError as error:
        raise TrialError(str(error)) from None
    if reference.planned and reference.object != specification.object:
        raise TrialError(
            f"the plan is for {reference.object}, not for {specification.object}: choose that object, or plan another"
        )
    tuned_by = None
    if monitor is None:
        path, name = Path(specification.reference), specification.object
        tuning = tuning_in(path) if reference.planned else tuning_of(name)
        monitor = None if tuning is None else tuning.monitor
        file = None if reference.planned else tuning_file(name)
        tuned_by = file if file is not None and file.parent == tuning_folder() else None
    prepared = PreparedTrial(specification, description, parameters, reference, limits, monitor, tuned_by)
    if specification.reaction is Reaction.CONTINUE and prepared.unwatched is None:
        return replace(prepared, specification=replace(specification, reaction=description.reaction))
    if prepared.unwatched is not None and specification.reaction is not Reaction.CONTINUE:
        raise TrialError(f"nothing would start the reaction {specification.reaction}: {prepared.unwatched}")
    return prepared


def _watched(prepared: PreparedTrial) -> Watched | None:
    """What the trial's monitor needs; None where no impact is expected."""
    reference, tuning = prepared.reference, prepared.monitor
    if tuning is None or reference.impact is None:
        return None
    k = round(reference.nominal_impact_s / reference.period_s)
    approach = np.array(reference.ante["twist"][:, k, :3])
    start = np.array(reference.ante["position"][:, 0])
    return Watched(tuning, reference.impact, prepared.specification.reaction, approach, start)


def _impact_window_s(reference: ExtendedReference) -> tuple[float, float]:
    """Return between which two moments the pads may be hit, s: until they have let go again, of a push to the end."""
    end_s = reference.release_s + FREE_AFTER_S if reference.motion is Motion.GRAB else math.inf
    return reference.nominal_impact_s - UNTIL_BEFORE_S, min(end_s, reference.ticks * reference.period_s)


def run_trial(
    prepared: PreparedTrial,
    cell: Cell,
    context: RunContext = NO_CONTEXT,
    *,
    way: StartMotion | None = None,
    criterion: SuccessCriterion | None = None,
) -> TrialResult:
    """Run a prepared trial on an open cell. The caller closes the cell; the context's log is closed here.

    way: to where the reference begins, gone before its first tick.
    """
    specification, reference = prepared.specification, prepared.reference
    control = prepared.parameters.control
    plan = SessionPlan(
        reference.ante, reference.post, Mode.ANTE_IMPACT, control.stiffness, reference.period_s,
        impact_s=_impact_window_s(reference),
    )  # fmt: skip
    with Run(prepared.description, prepared.parameters, plan, prepared.limits, context, way) as run:
        if prepared.unwatched is not None:
            run.run_event(RunEvent(Level.INFO, "verdict", f"not watched: {prepared.unwatched}"))
        elif prepared.tuned_by is not None:
            run.run_event(RunEvent(Level.INFO, "verdict", f"watched as {prepared.tuned_by} says"))
        factory = controller_factory(specification.controller)
        settle = partial(settle_load, prepared.description, specification.object, context)
        outcome = run.follow(cell, factory, reference.nominal_impact_s, _watched(prepared), settle)
        values = score(
            run.history.columns(), outcome.start_t_ns, reference.nominal_impact_s, reference.release_s,
            run.first_impact_s, criterion or SuccessCriterion(), reference.motion,
            (prepared.description.left.robot.urdf, prepared.description.right.robot.urdf),
            base_poses(prepared.description), prepared.description.tracker.kind == NO_TRACKER,
        )  # fmt: skip
        return run.finished(_result(prepared, cell.name, outcome, values, run))


def _result(prepared: PreparedTrial, cell: str, outcome: SessionOutcome, values: Score, run: Run) -> TrialResult:
    reason = failure_reason(
        outcome.end, outcome.detail, outcome.safety_interventions, values, prepared.reference.motion
    )
    specification, monitor = prepared.specification, run.monitor
    decided = monitor is not None and monitor.verdict is not Verdict.NONE
    return TrialResult(
        success=reason is None,
        failure_reason=reason,
        controller=specification.controller,
        object=specification.object,
        displacement_mm=specification.displacement_mm,
        displacement_x_mm=specification.displacement_x_mm,
        yaw_deg=specification.yaw_deg,
        object_observed=values.seen,
        seed=specification.seed,
        cell=cell,
        nominal_impact_time_s=prepared.reference.nominal_impact_s,
        detected_impact_time_s=values.detected_impact_time_s,
        impact_verdict=monitor.verdict.name.lower() if monitor is not None else None,
        average_force_norm=values.average_force_norm,
        average_force_norm_linear_n=values.average_force_norm_linear_n,
        peak_force_norm=values.peak_force_norm,
        max_lift_mm=values.max_lift_mm,
        peak_torque_ratio=values.peak_torque_ratio,
        peak_velocity_ratio=values.peak_velocity_ratio,
        ticks=values.ticks,
        missed_deadlines=values.missed_deadlines,
        compute_us_p50=values.compute_us_p50,
        compute_us_p99=values.compute_us_p99,
        safety_interventions=outcome.safety_interventions,
        real_time_factor=round(outcome.real_time_factor, 3),
        log=run.log_name,
        impact_reason=monitor.reason.name.lower() if monitor is not None and monitor.unexpected else None,
        impact_kind=str(run.kind) if run.kind is not None else None,
        impact_margin=float(monitor.pair[0]["margin"]) if monitor is not None else None,
        impact_verdict_time_s=float(monitor.pair[0]["t_verdict_ns"]) * 1e-9 if monitor and decided else None,
    )
