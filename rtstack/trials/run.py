"""Runs a trial or a demonstration on a cell and writes its log. One process, one MCAP file."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from hal.cell import Cell
from hal.errors import HardwareError
from hal.realtime import realtime_thread
from rtstack.control.modes import Strategy
from rtstack.control.watch import TrialMonitor
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.loop.fault import Fault
from rtstack.loop.history import Columns, History
from rtstack.loop.publisher import Publisher
from rtstack.loop.session import Plan, Session, SessionOutcome, StopSignal
from rtstack.loop.watchdogs import Trip, Watchdog
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.pair import PairParameters
from rtstack.monitor.records import Verdict
from rtstack.references.demonstration import Grab, grab, scripted_targets
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.references.spreading import ExtendedReference
from rtstack.safety.limits import SafetyLimits
from rtstack.samples import Level, Mode, Reaction
from rtstack.trials.assembly import (
    STRATEGIES,
    Parameters,
    Watched,
    arm_controllers,
    cell_parameters,
    dual_arm_controller,
    safety_judges,
)
from rtstack.trials.attendant import Attendant, Remark
from rtstack.trials.errors import TrialError
from rtstack.trials.evidence import evidence_of
from rtstack.trials.monitoring import tuning_of
from rtstack.trials.record import TrialLog
from rtstack.trials.result import DemonstrationResult, PlaybackResult, TeleoperationResult, TrialResult
from rtstack.trials.scoring import Score, SuccessCriterion, failure_reason, score
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import safety_limits
from rtstack.trials.unexpected import Unexpected, classify

Progress = Callable[[float], None]
PROGRESS_TICKS = 50  # how often progress is told
ROOM_TICKS = 16  # how often a run that may wait looks whether the log keeps up; the rings have room for many more
SPARE_TICKS = 1500  # of history, for the stop after the reference
NEWEST_TICKS = 4000  # of history, where a run has no length: a fault's last second, and the stop after it


@dataclass(frozen=True, slots=True)
class PreparedTrial:
    """A trial whose reference was read and checked: nothing is open and nothing written yet.

    monitor: None where the object has no tuning.
    """

    specification: TrialSpecification
    description: CellDescription
    parameters: Parameters
    reference: ExtendedReference
    limits: SafetyLimits
    monitor: PairParameters | None = None

    @property
    def unwatched(self) -> str | None:
        """Why nobody judges the impact, and what to do about it; None where the monitor does."""
        if self.reference.impact is None:
            return "it follows a plan, and nobody knows what the joints are to do"
        if self.monitor is not None:
            return None
        name = self.specification.object
        return (
            f"the monitor is not tuned for {name}; make a tuning of its good runs: "
            f"rtstack tune-monitor LOG.mcap... --out deploy/monitor/{name}.toml"
        )


def prepare_trial(
    specification: TrialSpecification,
    description: CellDescription,
    parameters: Parameters | None = None,
    monitor: PairParameters | None = None,
) -> PreparedTrial:
    """Read and check what a trial needs. monitor: by default the object's committed tuning, if it has one.

    Raises TrialError with one line, also for a reaction that nothing could start.
    """
    parameters = parameters or cell_parameters(description)
    check_object(specification.object, description)
    limits = safety_limits(description, specification.safety)
    try:
        reference = load_reference(
            Path(specification.reference), arm_controllers(description, parameters), parameters.detector
        )
    except ReferenceError as error:
        raise TrialError(str(error)) from None
    if monitor is None and (tuning := tuning_of(specification.object)) is not None:
        monitor = tuning.monitor
    prepared = PreparedTrial(specification, description, parameters, reference, limits, monitor)
    if prepared.unwatched is not None and specification.reaction is not Reaction.CONTINUE:
        raise TrialError(f"nothing would start the reaction {specification.reaction}: {prepared.unwatched}")
    return prepared


def _watched(prepared: PreparedTrial) -> Watched | None:
    """What the trial's monitor needs; None where nobody knows what to expect."""
    reference, tuning = prepared.reference, prepared.monitor
    if tuning is None or reference.impact is None:
        return None
    k = round(reference.nominal_impact_s / reference.period_s)
    approach = np.array(reference.ante["twist"][:, k, :3])
    start = np.array(reference.ante["position"][:, 0])
    return Watched(tuning, reference.impact, prepared.specification.reaction, approach, start)


def check_object(name: str, description: CellDescription) -> None:
    """Raise TrialError for an object that the cell does not have."""
    if name not in description.objects:
        known = ", ".join(description.objects)
        raise TrialError(f"unknown object {name!r}: the cell {description.name} has {known}")


def run_trial(
    prepared: PreparedTrial,
    cell: Cell,
    *,
    log: TrialLog | None,
    live: Rings | None = None,
    stop: StopSignal | None = None,
    progress: Progress | None = None,
    way: StartMotion | None = None,
    watchdogs: Sequence[Watchdog] = (),
    attendant: Attendant | None = None,
    criterion: SuccessCriterion | None = None,
) -> TrialResult:
    """Run a prepared trial on an open cell. The caller closes the cell; the log is closed here, with the result in it.

    live: rings of whoever watches. way: to where the reference begins, gone before its first tick. watchdogs: what has
    to give signs of life meanwhile. attendant: whose remarks go into the log, and who learns how the session ended.
    A log that could not be finished fails the trial, and the reason says so.
    """
    specification, reference = prepared.specification, prepared.reference
    control = prepared.parameters.control
    plan = Plan(reference.ante, reference.post, Mode.ANTE_IMPACT, control.stiffness, reference.period_s)
    run = Run(
        prepared.description, prepared.parameters, plan, log, live, stop, progress, way, watchdogs, attendant,
        prepared.limits,
    )  # fmt: skip
    if prepared.unwatched is not None:
        run.remark(Remark(Level.INFO, "verdict", f"not watched: {prepared.unwatched}"))
    with log_of(log):
        strategy = STRATEGIES[specification.controller]
        outcome = run.follow(cell, strategy, reference.nominal_impact_s, _watched(prepared))
        values = score(
            run.history.columns(), outcome.start_t_ns, reference.nominal_impact_s, reference.release_s,
            run.first_impact_s, criterion or SuccessCriterion(), reference.motion,
        )  # fmt: skip
        result = _trial_result(prepared, cell.name, outcome, values, log, run)
        incomplete = log.close(result.as_dict()) if log is not None else None
    return with_log(result, incomplete)


def run_demonstration(
    specification: DemonstrationSpecification,
    description: CellDescription,
    cell: Cell,
    *,
    log: TrialLog | None,
    live: Rings | None = None,
    stop: StopSignal | None = None,
    progress: Progress | None = None,
    parameters: Parameters | None = None,
    script: Grab | None = None,
    way: StartMotion | None = None,
    watchdogs: Sequence[Watchdog] = (),
    attendant: Attendant | None = None,
) -> DemonstrationResult:
    """Run a scripted demonstration through the teleoperation path on an open cell. Closes the log, not the cell.

    script: what to do instead of the specification's variation. way: to home, gone before the first tick.
    """
    parameters = parameters or cell_parameters(description)
    check_object(specification.object, description)
    arms = arm_controllers(description, parameters)
    period_s = parameters.control.period_s
    targets = scripted_targets(
        script or grab(specification.variation, specification.speed_m_s),
        (arms[0].model, arms[1].model),
        np.array([description.left.home, description.right.home]),
        description.objects[specification.object],
        description.table,
        period_s,
    )
    plan = Plan(targets, targets, Mode.TELEOPERATION, parameters.control.stiffness_teleoperation, period_s)
    run = Run(
        description, parameters, plan, log, live, stop, progress, way, watchdogs, attendant, safety_limits(description)
    )  # fmt: skip
    with log_of(log):
        outcome = run.follow(cell, Strategy.PROPOSED, 0.0)
        result = _demonstration_result(specification, cell.name, outcome, run, log)
        incomplete = log.close(result.as_dict()) if log is not None else None
    return with_log(result, incomplete)


def run_motion(
    plan: Plan,
    description: CellDescription,
    parameters: Parameters,
    cell: Cell,
    *,
    log: TrialLog | None,
    stop: StopSignal | None = None,
    progress: Progress | None = None,
    way: StartMotion | None = None,
    watchdogs: Sequence[Watchdog] = (),
) -> tuple[str | None, Columns]:
    """Follow a plan that meets nothing, on an open cell. Closes the log, not the cell.

    Returns why it failed, None for a success, and the samples.
    """
    limits = safety_limits(description)
    run = Run(description, parameters, plan, log, None, stop, progress, way, watchdogs, None, limits)
    with log_of(log):
        outcome = run.follow(cell, Strategy.PROPOSED, 0.0)
        reason = failure_reason(outcome.end, outcome.detail, outcome.safety_interventions)
        result = {"success": reason is None, "failure_reason": reason}
        incomplete = log.close(result) if log is not None else None
    return reason or incomplete, run.history.columns()


Result = TypeVar("Result", TrialResult, DemonstrationResult, TeleoperationResult, PlaybackResult)


def with_log(result: Result, incomplete: str | None) -> Result:
    """A run whose evidence is incomplete has failed, whatever the arms did."""
    return result if incomplete is None else replace(result, success=False, failure_reason=incomplete)


@contextmanager
def log_of(log: TrialLog | None) -> Iterator[None]:
    """Finish the log even where the run broke off."""
    try:
        yield
    except BaseException:
        if log is not None:
            log.abandon()
        raise


class Run:
    """What a trial, a demonstration, a playback and a teleoperation have in common: one session with its history.

    share: how much of a run is over whose plan is written as it goes, None where nobody knows.
    """

    share: Callable[[], float] | None = None

    def __init__(
        self, description: CellDescription, parameters: Parameters, plan: Plan, log: TrialLog | None,
        live: Rings | None, stop: StopSignal | None, progress: Progress | None, way: StartMotion | None,
        watchdogs: Sequence[Watchdog], attendant: Attendant | None, limits: SafetyLimits,
    ) -> None:  # fmt: skip
        self._description = description
        self._parameters = parameters
        self._plan = plan
        self._log = log
        self._live = live
        self._stop = stop
        self._progress = progress
        self._way = way
        self._watchdogs = (*watchdogs, *([log] if log is not None else []))
        self._attendant = attendant
        self._limits = limits
        self._publisher: Publisher | None = None
        endless = plan.guide is not None
        self.history = History(NEWEST_TICKS if endless else plan.ticks + SPARE_TICKS, endless)
        if log is not None:
            log.take_from(self.history)
        self.first_impact_s: float | None = None
        self.monitor: TrialMonitor | None = None
        self.kind: Unexpected | None = None
        self._remarks: list[Remark] = []

    def remark(self, remark: Remark) -> None:
        """Have an event in the log and in front of whoever watches, from the first tick on."""
        self._remarks.append(remark)

    def follow(
        self, cell: Cell, strategy: Strategy, nominal_impact_s: float, watched: Watched | None = None
    ) -> SessionOutcome:
        """Follow the plan on the cell to its end."""
        controller = dual_arm_controller(self._description, self._parameters, strategy, nominal_impact_s, watched)
        self.monitor = controller.monitor
        rings = [*([self._live] if self._live else []), *(self._log.listening if self._log else ())]
        publisher = self._publisher = Publisher(rings, self.history)
        judges = safety_judges(self._description, self._limits)
        session = Session(
            cell, controller, judges, publisher, self._plan, self._stop, self._between_ticks,
            self._description.torque_filter.cutoff_hz, self._watchdogs,
        )  # fmt: skip
        if self._log is not None:
            self._log.wait_ready()
        with realtime_thread() if cell.own_clocks else nullcontext():
            outcome = self._go_to_start(cell, publisher) or session.run()
        if outcome.fault is not None and self._log is not None:
            self._log.evidence = evidence_of(outcome.fault, self.history.columns(), self._parameters.solver)
        self._say_kind(outcome)
        if controller.first_impact_s >= 0.0:
            self.first_impact_s = controller.first_impact_s
        self._pass_on_remarks()
        if self._attendant is not None:
            self._attendant.ended(outcome.end, outcome.detail)
        return outcome

    def _say_kind(self, outcome: SessionOutcome) -> None:
        """Say what an unexpected impact was, once all of it has been seen."""
        columns = self.history.columns()
        if self.monitor is None or self._publisher is None or columns.arm.shape[1] == 0:
            return
        if outcome.end.is_fault:
            self.monitor.stopped_by_fault()
        self.kind = classify(self.monitor, columns, outcome.start_t_ns)
        if self.kind is not None:
            t_ns = int(columns.arm[0]["t_ns"][-1])
            self._publisher.event(t_ns, Level.WARNING, "verdict", f"probably: {self.kind}")

    def _go_to_start(self, cell: Cell, publisher: Publisher) -> SessionOutcome | None:
        """Go the way to the start; return the outcome of a run that ended on it, None where the arms are there."""
        way = self._way
        if way is None or cell.link is None:
            return None
        t_ns = cell.left.read().t_ns
        publisher.event(t_ns, Level.INFO, "start", way.summary)
        trip = Trip(End.STOP_REQUESTED, "on the way to the start pose", Level.WARNING)
        found: list[Trip] = []

        def stop() -> bool:
            if self._log is not None:
                self._log.wait_for_room()
            found.extend(filter(None, (watchdog.trip() for watchdog in self._watchdogs)))
            return bool(found) or (self._stop is not None and self._stop.stop_requested)

        try:
            if cell.link.move(way.path.goal, way.limit, stop):
                return None
            if found:
                trip = replace(found[0], detail=f"on the way to the start pose: {found[0].detail}")
        except HardwareError as error:
            trip = Trip(End.HARDWARE, f"on the way to the start pose: {error}")
        publisher.event(t_ns, trip.level, "start", trip.text)
        fault = Fault(trip, t_ns, None) if trip.end.is_fault else None
        return SessionOutcome(trip.end, trip.detail, 0, 0, 0, 0.0, fault)

    def _between_ticks(self, index: int) -> None:
        if index % ROOM_TICKS == 0 and self._log is not None:
            self._log.wait_for_room()
        if self._progress is not None and index % PROGRESS_TICKS == 0:
            if self._plan.guide is None:
                self._progress(min(1.0, index / self._plan.ticks))
            elif self.share is not None:
                self._progress(self.share())
        self._pass_on_remarks()

    def _pass_on_remarks(self) -> None:
        if self._publisher is None:
            return
        if self._attendant is not None:
            self._remarks.extend(self._attendant.remarks())
        while self._remarks:
            remark = self._remarks.pop(0)
            t_ns = int(self._publisher.timing["t_ns"][0])
            self._publisher.event(t_ns, remark.level, remark.name, remark.text)


def _demonstration_result(
    specification: DemonstrationSpecification, cell: str, outcome: SessionOutcome, run: Run, log: TrialLog | None
) -> DemonstrationResult:
    impact_s = run.first_impact_s
    values = score(run.history.columns(), outcome.start_t_ns, impact_s or 0.0, 0.0, impact_s, SuccessCriterion())
    reason = failure_reason(outcome.end, outcome.detail, outcome.safety_interventions)
    if reason is None and impact_s is None:
        reason = "no impact was detected"
    return DemonstrationResult(
        success=reason is None,
        failure_reason=reason,
        object=specification.object,
        variation=specification.variation,
        seed=specification.seed,
        cell=cell,
        detected_impact_time_s=impact_s,
        max_lift_mm=values.max_lift_mm,
        ticks=values.ticks,
        missed_deadlines=outcome.missed_deadlines,
        safety_interventions=outcome.safety_interventions,
        log=str(log.path) if log is not None else None,
    )


def _trial_result(
    prepared: PreparedTrial, cell: str, outcome: SessionOutcome, values: Score, log: TrialLog | None, run: Run
) -> TrialResult:
    reason = failure_reason(
        outcome.end, outcome.detail, outcome.safety_interventions, values, prepared.reference.motion
    )
    specification, monitor = prepared.specification, run.monitor
    decided = monitor is not None and monitor.verdict is not Verdict.NONE
    return TrialResult(
        success=reason is None,
        failure_reason=reason,
        controller=str(specification.controller),
        object=specification.object,
        displacement_mm=specification.displacement_mm,
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
        log=str(log.path) if log is not None else None,
        impact_reason=monitor.reason.name.lower() if monitor is not None and monitor.unexpected else None,
        impact_kind=str(run.kind) if run.kind is not None else None,
        impact_margin=float(monitor.pair[0]["margin"]) if monitor is not None else None,
        impact_verdict_time_s=float(monitor.pair[0]["t_verdict_ns"]) * 1e-9 if monitor and decided else None,
    )
