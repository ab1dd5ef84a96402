"""A run: one session on a cell, with its history, its log, its context, and what the log keeps of a fault."""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from io import BytesIO
from typing import Any, Self, TypeVar

import numpy as np

from hal.base.realtime import realtime_thread
from hal.cell import Cell
from hal.errors import HardwareError
from hal.sensor import Sensor
from rtstack.control.modes import Strategy
from rtstack.control.qp_law import QpLaw
from rtstack.control.watch import TrialMonitor
from rtstack.log.time_of_day import take_pair
from rtstack.log.writing.job import Attachment, Evidence
from rtstack.loop.end import End
from rtstack.loop.fault import Fault
from rtstack.loop.history import Columns, History
from rtstack.loop.plan import SessionPlan
from rtstack.loop.publisher import Publisher
from rtstack.loop.session import Session, SessionOutcome
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.safety.limits import ForcePhase, PairLimits
from rtstack.samples import Level, QpSolver
from rtstack.trials.assembly import (
    ControllerFactory,
    ControllerRequest,
    DetectorFactory,
    Parameters,
    Watched,
    arm_controllers,
    cell_controller,
    cell_parameters,
    following,
    safety_judges,
)
from rtstack.trials.errors import TrialError
from rtstack.trials.result import Result
from rtstack.trials.run_context import RunContext, RunEvent
from rtstack.trials.specification import like
from rtstack.trials.start_motion import MeasuredPoints, StartMotion, led_in
from rtstack.trials.tightening import limits_of_arms, limits_of_cell
from rtstack.trials.unexpected import Unexpected, classify

PROGRESS_TICKS = 50  # how often progress is told
ROOM_TICKS = 16  # how often a run that may wait looks whether the log keeps up; the rings have room for many more
SPARE_TICKS = 1500  # of history, for the stop after the reference
NEWEST_TICKS = 4000  # of history, where a run has no length: a fault's last second, and the stop after it

Kind = TypeVar("Kind", bound=Result)
_PROPOSED = following(Strategy.PROPOSED)
BEFORE_NS, AFTER_NS = 1_000_000_000, 100_000_000  # of the last second: the fault's tick, and how the stop begins
ON_THE_WAY = "on the way to the start pose"
START_MOTION = "start_motion.npz"  # arm and control (arms, n), timing (n,), as in last_second.npz
ARRIVED_RAD = 0.02  # friction leaves less than 0.005


def evidence_of(fault: Fault, columns: Columns, solver: QpSolver) -> Evidence:
    """Return what the log keeps of a fault. columns: what the run has published, whatever the rings have lost of it.
    last_second.npz: arm and control (2, n), timing (n,) and object (m,), records of rtstack.samples, and t_ns, the
    fault's. qp.npz: min 1/2 x^T H x + g^T x, lower <= x <= upper, tau_lower <= M x <= tau_upper, x (7,) rad/s^2."""

    def near(t_ns: Any) -> Any:
        return (t_ns >= fault.t_ns - BEFORE_NS) & (t_ns <= fault.t_ns + AFTER_NS)

    rows, seen = near(columns.timing["t_ns"]), near(columns.object["t_ns"])
    attachments = [
        _arrays(
            "last_second.npz", arm=columns.arm[:, rows], control=columns.control[:, rows], timing=columns.timing[rows],
            object=columns.object[seen], t_ns=fault.t_ns,
        )
    ]  # fmt: skip
    if (qp := fault.qp) is not None:
        problem = qp.problem[0]
        attachments.append(_arrays(
            "qp.npz", H=problem["H"], g=problem["gradient"], lower=problem["lower"], upper=problem["upper"],
            M=problem["M"], tau_lower=problem["tau_lower"], tau_upper=problem["tau_upper"], x=problem["ddq"],
            side=qp.side, status=qp.status.name, iterations=qp.iterations, solver=str(solver),
        ))  # fmt: skip
    if fault.traceback:
        attachments.append(Attachment("traceback.txt", "text/plain", fault.traceback.encode()))
    trip = fault.trip
    record = {
        "end": str(trip.end),
        "detail": trip.detail,
        "side": trip.side,
        "joint": str(trip.joint or ""),
        "value": "" if np.isnan(trip.value) else repr(trip.value),
        "bound": "" if np.isnan(trip.bound) else repr(trip.bound),
        "t_ns": str(fault.t_ns),
        "reaction_ticks": "" if fault.reaction_ticks is None else str(fault.reaction_ticks),
        "evidence": ", ".join(attachment.name for attachment in attachments),
    }
    return Evidence(record, tuple(attachments))


def _arrays(name: str, **arrays: Any) -> Attachment:
    file = BytesIO()
    np.savez_compressed(file, **arrays)
    return Attachment(name, "application/x-npz", file.getvalue())


class Run:
    """What all kinds of run have in common. Left by an exception, it finishes its log without a result. share: how much
    of a run is over whose plan is written as it goes, None where not known. between: called between two ticks with the
    number of the last one, before what is said is passed on."""

    share: Callable[[], float] | None = None
    between: Callable[[int], None] | None = None

    def __init__(
        self, description: CellDescription, parameters: Parameters, plan: SessionPlan, limits: PairLimits,
        context: RunContext, way: StartMotion | None, longest: int = 0, leads: Sequence[Sensor] = (),
    ) -> None:  # fmt: skip
        """longest: ticks of a run whose plan is written as it goes, where all of it is to be kept."""
        self._description = description
        self._parameters = parameters
        self._plan = plan
        self._limits = limits
        self._context, self._log = context, context.log
        self._way = way
        self._leads = leads
        self._watchdogs = (*context.watchdogs, *([context.log] if context.log is not None else []))
        self._publisher: Publisher | None = None
        endless = plan.source is not None and not longest
        self.history = History(
            NEWEST_TICKS if endless else max(plan.ticks, longest) + SPARE_TICKS, endless, description.sides
        )
        if context.log is not None:
            context.log.take_from(self.history)
        self.log_name = context.log_name
        self.first_impact_s: float | None = None
        self.monitor: TrialMonitor | None = None
        self.kind: Unexpected | None = None
        self.plain_python: str | None = None  # of an arm's QP, and what it takes of a tick
        self.failed: str | None = None  # why an operator's program has, by the event that it reported so
        self._run_events: list[RunEvent] = []
        self._began_ns = 0  # the way to the start, by the robot's time
        self._cell = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and self._log is not None:
            self._log.abandon()

    def finished(self, kind: type[Kind], reason: str | None, *records: Any, **more: Any) -> Kind:
        """Close the log with a result of this kind, made as by `like`, and return it. reason: why the run failed, None
        for a success. One whose evidence is incomplete has failed, whatever the arms did."""
        more |= {"success": reason is None, "failure_reason": reason, "cell": self._cell, "log": self.log_name}
        result = like(kind, *records, **more)
        incomplete = self.close(result.as_dict())
        return result if incomplete is None else replace(result, success=False, failure_reason=incomplete)

    def close(self, result: dict[str, Any]) -> str | None:
        """Close the log with these values. Returns None, or in one line why the log is not complete."""
        return self._log.close(result) if self._log is not None else None

    def run_event(self, run_event: RunEvent) -> None:
        """Publish an event in the log and to live viewers, from the first tick on."""
        self._run_events.append(run_event)

    def follow(
        self, cell: Cell, factory: ControllerFactory = _PROPOSED, nominal_impact_s: float = 0.0,
        watched: Watched | None = None, settle: Callable[[Cell, End], str] | None = None,
        detector: DetectorFactory | None = None,
    ) -> SessionOutcome:  # fmt: skip
        """Follow the plan on the cell to its end, by default with the proposed strategy, no impact meant. settle: does
        something about a load that is still held, and says what in one line. detector: of impacts, in the place of
        Appendix B's."""
        self._cell, self._limits = cell.name, limits_of_cell(self._limits, cell)
        controller = cell_controller(
            self._description, self._parameters, factory, nominal_impact_s, watched, self._limits, detector
        )
        self.monitor = controller.monitor
        publisher = self._publisher = Publisher(
            self._context.listening, self.history, cell.sensors, self._leads, cell.sides
        )
        judges = safety_judges(self._description, self._limits)
        session = Session(
            cell, controller, judges, publisher, self._plan, self._context.stop, self._between_ticks,
            self._description.torque_filter.cutoff_hz, self._watchdogs,
        )  # fmt: skip
        if cell.warning:
            self.run_event(RunEvent(Level.WARNING, "cell", cell.warning))
        if self._log is not None:
            self._log.wait_ready()
        with realtime_thread() if cell.own_clocks or cell.paced else nullcontext():
            outcome = self._make_ready(cell, publisher)
            if outcome is None:
                outcome = session.run()
                self._keep_evidence(outcome, self.history.columns())
        self._say_kind(outcome)
        laws = [law for law in getattr(controller, "laws", None) or () if isinstance(law, QpLaw)]
        if laws and outcome.end is not End.CONTROLLER_EXCEPTION and (costs := laws[0].costs()):
            self.plain_python = ", ".join(f"{name} {us:.1f} us" for name, us in costs.items())
        if controller.first_impact_s >= 0.0:
            self.first_impact_s = controller.first_impact_s
        if settle is not None and (said := settle(cell, outcome.end)):
            self.run_event(RunEvent(Level.WARNING, "load", said))
        self._pass_on_run_events()
        if self._context.run_observer is not None:
            self._context.run_observer.ended(outcome.end, outcome.detail)
        return outcome

    def _tell_collisions(self, cell: Cell, phase: ForcePhase) -> None:
        """Tell the robots, which take it between two motions only. Raises CommandRejected, ConnectionLost."""
        cell.set_collisions(*(limits.collisions(phase) for limits in self._limits))

    def _say_kind(self, outcome: SessionOutcome) -> None:
        """Say what an unexpected impact was, once all of it has been seen."""
        columns = self.history.columns()
        if self.monitor is None or self._publisher is None or columns.arm.shape[1] == 0:
            return
        if outcome.end.is_fault:
            self.monitor.stopped_by_fault()
        way, period_s = self._plan.ante["position"], self._plan.period_s
        self.kind = classify(self.monitor, columns, base_poses(self._description), outcome.start_t_ns, way, period_s)
        if self.kind is not None:
            self._publisher.event(int(columns.arm[0]["t_ns"][-1]), Level.WARNING, "verdict", f"probably: {self.kind}")

    def _make_ready(self, cell: Cell, publisher: Publisher) -> SessionOutcome | None:
        """Go the way to the start, and tell the robots what forces the session may come to; return the outcome of a run
        that ended before it."""
        if cell.link is None:
            return None
        outcome = None
        try:
            if self._way is not None:
                outcome = self._go_to_start(cell, self._way, publisher)
            if outcome is None:
                self._tell_collisions(cell, self._plan.widest_phase)
        except (HardwareError, TrialError) as error:
            outcome = SessionOutcome(End.HARDWARE, str(error), 0, 0, 0, 0.0)
        if outcome is None:
            return None
        detail = ON_THE_WAY + (f": {outcome.detail}" if outcome.detail else "")
        level = Level.ERROR if outcome.end.is_fault else Level.WARNING
        publisher.event(self._began_ns, level, "start", f"{outcome.end}: {detail}")
        return replace(outcome, detail=detail, start_t_ns=0)

    def _go_to_start(self, cell: Cell, way: StartMotion, publisher: Publisher) -> SessionOutcome | None:
        """Follow the way to the start under torque, judged as any motion; return the outcome where the arms have not
        arrived. The log has its samples as an attachment: its topics begin with the run."""
        description, log = self._description, self._log
        limits, parameters = limits_of_cell(limits_of_arms(description), cell), cell_parameters(description)
        now = np.stack([arm.read().q.copy() for arm in cell.arms])
        limits = led_in(limits, description, now)
        request = ControllerRequest(description, parameters, arm_controllers(description, parameters, limits), 0.0)
        laws, lasts_s = way.laws(request.arms, parameters.friction, now)
        measured, period_s = MeasuredPoints(lasts_s, len(laws)), parameters.control.period_s
        plan = SessionPlan.from_source(measured, parameters.control.stiffness, period_s, ForcePhase.APPROACH)
        history = History(round(lasts_s / period_s) + SPARE_TICKS, False, description.sides)
        kept = Publisher([], history, sides=cell.sides)  # live views would take it for the run
        self._began_ns = 0 if cell.waits else cell.arms[0].read().t_ns
        publisher.event(self._began_ns, Level.INFO, "start", way.summary)
        self._tell_collisions(cell, ForcePhase.APPROACH)
        session = Session(
            cell, request.pair(request.modes(Strategy.PROPOSED), laws), safety_judges(description, limits), kept, plan,
            self._context.stop,
            None if log is None else lambda index: log.wait_for_room() if index % ROOM_TICKS == 0 else None,
            description.torque_filter.cutoff_hz, (*self._watchdogs, measured),
        )  # fmt: skip
        outcome, columns = session.run(), history.columns()
        samples = _arrays(START_MOTION, arm=columns.arm, control=columns.control, timing=columns.timing)
        self._keep_evidence(outcome, columns, samples)
        if outcome.end is not End.COMPLETED:
            return outcome
        off = np.abs(columns.arm["q"][:, -1] - way.path.goal)
        if off.max() <= ARRIVED_RAD:
            return None
        arm, joint = np.unravel_index(off.argmax(), off.shape)
        detail = f"joint {joint + 1} of the {cell.sides[arm]} arm stays {off.max():.3f} rad away from it"
        return replace(outcome, end=End.HARDWARE, detail=detail)

    def _keep_evidence(self, outcome: SessionOutcome, columns: Columns, *more: Attachment) -> None:
        """Have the log keep what a fault leaves, and more; show its traceback where RTSTACK_TRACEBACK is set."""
        if outcome.fault is not None and outcome.fault.traceback and os.environ.get("RTSTACK_TRACEBACK"):
            sys.stderr.write(outcome.fault.traceback)
        if self._log is None:
            return
        found = Evidence({}, ())
        if outcome.fault is not None:
            found = evidence_of(outcome.fault, columns, self._parameters.solver)
        kept = () if self._log.evidence is None else self._log.evidence.attachments
        self._log.evidence = Evidence(found.fault, (*kept, *found.attachments, *more))

    def _between_ticks(self, index: int) -> None:
        if self.between is not None:
            self.between(index)
        if index % ROOM_TICKS == 0 and self._log is not None:
            if self._log.times is not None and self._publisher is not None:
                timing = self._publisher.timing[0]
                take_pair(self._log.times, int(timing["t_ns"]), float(timing["compute_us"]))
            self._log.wait_for_room()
        if self._context.progress is not None and index % PROGRESS_TICKS == 0:
            if self._plan.source is None:
                self._context.progress(min(1.0, index / self._plan.ticks))
            elif self.share is not None:
                self._context.progress(self.share())
        self._pass_on_run_events()

    def _pass_on_run_events(self) -> None:
        if self._publisher is None:
            return
        if self._context.run_observer is not None:
            self._run_events.extend(self._context.run_observer.run_events())
        while self._run_events:
            run_event = self._run_events.pop(0)
            if (run_event.level, run_event.name) == (Level.ERROR, "operator"):
                self.failed = run_event.text
            t_ns = int(self._publisher.timing["t_ns"][0])
            self._publisher.event(t_ns, run_event.level, run_event.name, run_event.text)
