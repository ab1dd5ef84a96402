"""Runs a trial on a cell: follow a reference through the impact, and score it. One process, one MCAP file."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hal.cell import Cell
from rtstack.control.watch import FREE_AFTER_S, UNTIL_BEFORE_S
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.model.tracker_description import NO_TRACKER
from rtstack.monitor.pair import PairParameters
from rtstack.monitor.records import Verdict
from rtstack.references.motion import Motion
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.references.spreading import ExtendedReference
from rtstack.safety.limits import PairLimits
from rtstack.samples import Level, Mode, Reaction
from rtstack.trials.assembly import ControllerFactory, Parameters, Watched, arm_controllers, cell_parameters, with_law
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.controllers import OwnFactory, controller_factory, detector_factory
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.followed import Followed
from rtstack.trials.monitoring import tuning_file, tuning_folder, tuning_in, tuning_of
from rtstack.trials.move import settle_load
from rtstack.trials.object import check_object, check_two_arms
from rtstack.trials.result import TrialResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext, RunEvent
from rtstack.trials.scoring import SuccessCriterion, object_problem, score
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.start_motion import StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms


@dataclass(frozen=True, slots=True)
class PreparedTrial(PreparedRun[TrialResult]):
    """A trial whose reference was read and checked; no cell and no log is open yet. monitor: None if the object, or the
    plan, has no tuning. tuned_by: the user's own file of the tuning, if it is one. criterion: of a success, by default
    the paper's. whole_reference: attach the reference's file to the log."""

    specification: TrialSpecification
    parameters: Parameters
    reference: ExtendedReference
    limits: PairLimits
    monitor: PairParameters | None = None
    tuned_by: Path | None = None
    criterion: SuccessCriterion | None = None
    whole_reference: bool = False

    def look(self, cell: Cell) -> str:
        """See PreparedRun: the offset of the force estimate."""
        return check_estimate(cell, self.description, self.parameters.detector)

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: to the start of the reference."""
        start = self.reference.ante[:, 0]
        return start_motion(cell, self.description, self.specification.object, self.displacement, start)

    def about(self) -> dict[str, Any]:
        followed = Followed(Path(self.specification.reference), self.whole_reference)
        return {"reference": self.reference, "followed": followed}

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> TrialResult:
        return run_trial(self, cell, context, way=way, criterion=self.criterion)

    @property
    def unwatched(self) -> str | None:
        """Why the impact is not monitored, and what to do about it; None if it is."""
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
    controller: ControllerFactory | None = None,
) -> PreparedTrial:
    """Read and check what a trial needs. monitor: by default what the plan brings, or the object's tuning. The result's
    specification names the inertia of the law, also where the cell or `parameters` decided. controller: in the place
    of the specification's. Raises TrialError with one line, also for a reaction that nothing could start."""
    if controller is not None:
        specification = replace(specification, controller=OwnFactory(controller))
    parameters = with_law(parameters or cell_parameters(description), specification.law_inertia)
    specification = replace(specification, law_inertia=parameters.inertia.law_inertia)
    check_object(specification.object, description)
    controller_factory(specification.controller)
    detector_factory(specification.detector)
    limits = limits_of_arms(description, specification.safety)
    try:
        reference = load_reference(
            Path(specification.reference), arm_controllers(description, parameters), parameters.detector,
            description.sides,
        )  # fmt: skip
    except ReferenceError as error:
        raise TrialError(str(error)) from None
    if reference.motion is Motion.GRAB:
        check_two_arms(description, "a trial of a grab")
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
    unwatched = prepared.unwatched is not None
    if unwatched and not (prepared.shadow or description.simulated) and description.unexpected_impact is None:
        raise TrialError(
            f'nothing watches the impact on these arms: {prepared.unwatched}; or write unexpected_impact = "continue" '
            "into the cell's file"
        )
    if specification.reaction is Reaction.CONTINUE and not unwatched:
        return replace(prepared, specification=replace(specification, reaction=description.reaction))
    if unwatched and specification.reaction is not Reaction.CONTINUE:
        raise TrialError(f"nothing would start the reaction {specification.reaction}: {prepared.unwatched}")
    return prepared


def _watched(prepared: PreparedTrial) -> Watched | None:
    """Return what the trial's monitor needs; None if no impact is expected."""
    reference, tuning = prepared.reference, prepared.monitor
    if tuning is None or reference.impact is None:
        return None
    k = round(reference.nominal_impact_s / reference.period_s)
    approach = np.array(reference.ante["twist"][:, k, :3])
    start = np.array(reference.ante["position"][:, 0])
    return Watched(tuning, reference.impact, prepared.specification.reaction, approach, start)


def _impact_window_s(reference: ExtendedReference) -> tuple[float, float]:
    """Return the first and last moment, s, at which the pads may be hit: until release, or to the end of a push."""
    end_s = reference.release_s + FREE_AFTER_S if reference.motion is Motion.GRAB else math.inf
    return reference.nominal_impact_s - UNTIL_BEFORE_S, min(end_s, reference.ticks * reference.period_s)


def run_trial(
    prepared: PreparedTrial, cell: Cell, context: RunContext = NO_CONTEXT, *, way: StartMotion | None = None,
    criterion: SuccessCriterion | None = None,
) -> TrialResult:  # fmt: skip
    """Run a prepared trial on an open cell. The caller closes the cell; the context's log is closed here. way: the
    motion to the start of the reference, carried out before its first tick."""
    specification, reference = prepared.specification, prepared.reference
    parameters = with_law(prepared.parameters, specification.law_inertia)
    control = parameters.control
    plan = SessionPlan(
        reference.ante, reference.post, Mode.ANTE_IMPACT, control.stiffness, reference.period_s,
        impact_s=_impact_window_s(reference),
    )  # fmt: skip
    with Run(prepared.description, parameters, plan, prepared.limits, context, way) as run:
        if prepared.unwatched is not None:
            run.run_event(RunEvent(Level.INFO, "verdict", f"not watched: {prepared.unwatched}"))
        elif prepared.tuned_by is not None:
            run.run_event(RunEvent(Level.INFO, "verdict", f"watched as {prepared.tuned_by} says"))
        if prepared.shadow:
            run.run_event(RunEvent(Level.WARNING, "shadow", "torques are computed and judged, and none is sent"))
        factory, detector = controller_factory(specification.controller), detector_factory(specification.detector)
        settle = partial(settle_load, prepared.description, specification.object, context)
        settle = None if prepared.shadow else settle
        outcome = run.follow(cell, factory, reference.nominal_impact_s, _watched(prepared), settle, detector)
        values = score(
            run.history.columns(), outcome.start_t_ns, reference.nominal_impact_s, reference.release_s,
            run.first_impact_s, criterion or SuccessCriterion(), reference.motion,
            [robot.urdf for robot in prepared.description.robots],
            base_poses(prepared.description), prepared.description.tracker.kind == NO_TRACKER,
        )  # fmt: skip
        reason = outcome.problem or object_problem(values, reference.motion)
        if prepared.shadow:
            reason = "shadow: no torque was sent" + (f"; the loop ended by: {reason}" if reason else "")
        monitor, said = run.monitor, dict[str, Any](impact_verdict=None)
        if monitor is not None:
            pair, verdict = monitor.pair[0], monitor.verdict
            said |= {"impact_verdict": verdict.name.lower(), "impact_margin": float(pair["margin"])}
            if verdict is not Verdict.NONE:
                said["impact_verdict_time_s"] = float(pair["t_verdict_ns"]) * 1e-9
            if monitor.unexpected:
                said["impact_reason"] = monitor.reason.name.lower()
        return run.finished(
            TrialResult, reason, specification, outcome, values, object_observed=values.seen,
            controller=str(specification.controller),
            nominal_impact_time_s=reference.nominal_impact_s, real_time_factor=round(outcome.real_time_factor, 3),
            impact_kind=None if run.kind is None else str(run.kind), plain_python=run.plain_python, **said,
        )  # fmt: skip
