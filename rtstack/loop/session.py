"""A session: one reference followed from its first tick to rest. Teleoperation and trials are the same loop.

The robot is the clock: `read` blocks until the next state. Nothing here sleeps, and nothing after the reads waits.
"""

import gc
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hal.cell import LEFT, RIGHT, Cell
from hal.compilation import compiled
from hal.errors import HardwareError
from hal.extensions import PLUG_INS_RAISE, blaming, raised
from hal.limits import CONTROL_PERIOD_S
from hal.state import ARM_STATE
from rtstack.control.controller import Controller
from rtstack.control.records import WORKSPACE
from rtstack.loop.command_echo import CommandEcho
from rtstack.loop.end import End
from rtstack.loop.event_reporter import EventReporter
from rtstack.loop.fault import Fault, FaultNotes, explained, plug_ins_of
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.plan import SessionPlan
from rtstack.loop.publisher import CycleReporter, Publisher
from rtstack.loop.standstill import REST_DQ, STOP_TICKS, StandstillDetector
from rtstack.loop.timeline import TICK_NS, Timeline
from rtstack.loop.watchdogs import FirstTorque, LostAnswers, TickOverrun, Watchdog, WatchdogTrip
from rtstack.safety.judge import Cause, ForcePhase, SafetyJudge
from rtstack.samples import ARM_SAMPLE, Level, Mode, QpStatus

_OF_THE_OTHER = (Cause.PAIR_SKEW, Cause.OTHER_ARM)  # the other arm's own reason says more
# looked up once: an enumeration's member costs 0.1 us
_STOPPING, _NOT_USED, _SOLVED = Mode.STOPPING, QpStatus.NOT_USED, QpStatus.SOLVED
_NO_REASON, _COMMANDED, _CONTROLLER = Cause.NONE, Cause.COMMANDED, Cause.CONTROLLER
_IMPACT, _CONTACT = ForcePhase.IMPACT, ForcePhase.CONTACT
_FIRST = ((), (0,), (1,), (0,))  # the arm to serve of a mask of LEFT and RIGHT
_MASK = {(): 0, (0,): LEFT, (1,): RIGHT, (0, 1): LEFT | RIGHT}  # of the arms that were served


def low_pass_share(cutoff_hz: float) -> float:
    """Return the share of the way to a new torque that is gone in one tick (libfranka, lowpass_filter.h); 1: all."""
    if cutoff_hz <= 0.0:
        return 1.0
    return CONTROL_PERIOD_S / (CONTROL_PERIOD_S + 1.0 / (2.0 * math.pi * cutoff_hz))


@compiled
def low_pass(samples, workspaces, share):
    """Move samples[0].tau_desired to `share` of the way from the last applied torque. What is no number stays none."""
    desired, last = samples[0].tau_desired, workspaces[0].tau_previous
    for i in range(7):
        desired[i] = last[i] + share * (desired[i] - last[i])


class StopSignal(Protocol):
    """A source of stop requests. Read once a tick."""

    @property
    def stop_requested(self) -> bool:
        """Whether a stop is asked for."""
        ...


@dataclass(frozen=True, slots=True)
class SessionOutcome:
    """end: how it ended; detail: which limit, error or QP status, empty where all went well; fault: the evidence.
    real_time_factor: robot's seconds over the host's, from the first tick to the last."""

    end: End
    detail: str
    start_t_ns: int
    missed_deadlines: int
    safety_interventions: int
    real_time_factor: float
    fault: Fault | None = None

    @property
    def problem(self) -> str | None:
        """Why it failed, in one line; None where it came to its end and the judge changed no torque."""
        if self.end is not End.COMPLETED:
            return f"{self.end}: {self.detail}" if self.detail else str(self.end)
        return f"the safety judge changed {self.safety_interventions} torques" if self.safety_interventions else None


class Session:
    """Runs a plan on a cell. `between_ticks` is called after the answers are out (progress, room in the log). Whatever
    ends it, the judge brakes the arms; what is said about it is said once the torque is out. Once the controller has
    raised, or takes too long, it is not asked again: the judge stops without it. cutoff_hz: of the low-pass of the
    desired torque, 0 for none. watchdogs: asked once a tick, beside `stop`."""

    def __init__(
        self,
        cell: Cell,
        controller: Controller,
        judges: Sequence[SafetyJudge],
        publisher: Publisher,
        plan: SessionPlan,
        stop: StopSignal | None = None,
        between_ticks: Callable[[int], None] | None = None,
        cutoff_hz: float = 0.0,
        watchdogs: Sequence[Watchdog] = (),
    ) -> None:
        self._cell = cell
        self._controller, self._machine, self._controlled = controller, controller.machine, controller.arms
        self._judges = tuple(judges)
        self._sides, self._all = cell.sides, tuple(range(len(cell.arms)))
        self._all_mask = _MASK[self._all]
        self._publisher = publisher
        self._plan = plan
        self._stop = stop
        self._mailbox, self._turn = stop if isinstance(stop, Mailbox) else None, 0  # its writers wait for a STOP's end
        self._between_ticks = between_ticks
        self._share = low_pass_share(cutoff_hz)
        if self._share < 1.0:  # compile it before the robot is armed
            low_pass(np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE), self._share)
        self._arms = cell.arms
        self._states = tuple(a.sample.view(np.uint8)[: ARM_STATE.itemsize] for a in controller.arms)
        # the record that an arm shows its states in, and its bytes
        self._shown: list[NDArray[np.void] | None] = [None] * len(self._arms)
        self._shown_bytes: list[NDArray[np.uint8]] = list(self._states)
        self._stamps = tuple(a.sample["t_ns"] for a in controller.arms)
        self._torques = tuple(a.sample["tau_applied"][0] for a in controller.arms)
        self._echoes = tuple(CommandEcho(judge, arm) for judge, arm in zip(judges, controller.arms, strict=True))
        self._records = tuple((a.sample, a.control) for a in controller.arms)
        self._residuals = tuple(a.control["momentum_residual"][0] for a in controller.arms)
        # views of single fields: what is looked up once costs a tick nothing
        self._stopping = tuple(judge.memory["stopping"].data for judge in judges)
        self._plug_ins = plug_ins_of(controller)
        with blaming("the controller does not take the reference", *self._plug_ins):
            controller.follow(plan.ante, plan.post, plan.stiffness)
        for judge, (sample, _), residual in zip(judges, self._records, self._residuals, strict=True):
            judge.bind(sample, residual)
        self._last_index = plan.ticks
        self._phase = plan.phase
        self._impact_ns, self._impact_end_ns = (round(t_s * 1e9) for t_s in plan.impact_s or (0.0, 0.0))
        self._own_clocks = cell.own_clocks
        self._time = Timeline(publisher.timing, cell.own_clocks, cell.waits, len(cell.arms))
        self._compute_us = publisher.timing["compute_us"]
        self._cycles = CycleReporter(cell.cycles if cell.own_clocks else None, self._stamps, publisher)
        self._overrun = TickOverrun(len(cell.arms))
        echoes = dict(zip(cell.sides, self._echoes, strict=True))
        own = (self._overrun, FirstTorque(echoes), LostAnswers(echoes))
        self._watchdogs = (*watchdogs, *own) if cell.own_clocks else tuple(watchdogs)
        self._notes = FaultNotes(cell.sides)
        self._reporter = EventReporter(publisher, controller, self._time, self._notes, cell.sides)
        self._alone = False  # the controller is not asked any more
        self._blind = False  # nor tracker and sensors
        self._unpublished = 0
        self._rest = StandstillDetector([a.sample["dq"][0] for a in controller.arms])

    def run(self) -> SessionOutcome:
        """Follow the plan to its end, brake, and leave torque control. Never raises for what robot or controller do."""
        collecting = gc.isenabled()
        gc.disable()  # a collection in the middle of a tick is a tick that waits
        self._count_turn(1)
        try:
            self._cell.start()
            with self._cycles.measuring():
                while self._tick():
                    self._pause()
        except HardwareError as error:
            self._reporter.end()
            self._end(WatchdogTrip(End.HARDWARE, str(error)))
            self._reporter.robot(error)
        finally:
            # whose state stands still may take its time to say that it has stopped
            blind = [judge.blind for judge in self._judges]
            first = RIGHT if blind[0] and not blind[-1] else LEFT
            self._cell.stop(first, at_rest=self._rest.reached and not any(blind))
            self._count_turn(0)
            if collecting:
                gc.enable()
        self._reporter.end()
        self._machine.rest()
        self._reporter.rest()
        if self._own_clocks:
            self._reporter.link(sum(echo.lost for echo in self._echoes))
        trip = self._notes.trip
        return SessionOutcome(
            end=trip.end,
            detail=trip.detail,
            start_t_ns=self._time.start_ns,
            missed_deadlines=self._time.missed,
            safety_interventions=sum(judge.interventions for judge in self._judges),
            real_time_factor=self._time.real_time_factor,
            fault=self._notes.fault(),
        )

    def _tick(self) -> bool:
        """One tick of the arms whose states have arrived. Returns whether to go on."""
        sides = self._receive()
        began_ns = time.perf_counter_ns()
        self._take_time(sides, began_ns)
        status = self._ask_for_torques(sides)
        self._judge(sides, status)
        if not self._own_clocks:
            self._look(self._time.origin_ns, self._time.now_ns)
        for k in sides:
            self._arms[k].write(self._torques[k])
        self._look_at_judges(status)
        try:
            self._reporter.tick()
            compute_us = (time.perf_counter_ns() - began_ns) * 1e-3  # without what measures it
            self._cycles.tick(sides)
            self._publish(sides, compute_us)
            self._reporter.end()
        except PLUG_INS_RAISE as error:
            self._go_on_alone(error)
        if self._own_clocks:
            self._overrun.take(sides, time.perf_counter_ns() - began_ns)
        for judge in self._judges:
            if judge.blind:
                return False  # only the robot itself can brake by a state that does not change
        return not (self._machine.mode is _STOPPING and 0 in sides and self._at_rest())

    def _count_turn(self, number: int) -> None:
        self._turn = number
        if self._mailbox is not None:
            self._mailbox.turn(number)

    def _pause(self) -> None:
        """Between two ticks, with the answers out."""
        self._count_turn(self._turn + 1)
        if self._between_ticks is not None:
            try:
                self._between_ticks(self._time.now_ns // TICK_NS)
            except PLUG_INS_RAISE as error:
                self._go_on_alone(error)

    def _receive(self) -> tuple[int, ...]:
        """Read all arms where they share a clock, else one whose state has arrived: the other one's turn is next.
        Answered together, the first one would wait for the second one's tick."""
        sides = _FIRST[self._cell.link.wait()] if self._own_clocks and self._cell.link is not None else self._all
        for k in sides:
            record = self._arms[k].read().record
            if record is not self._shown[k]:
                self._shown[k], self._shown_bytes[k] = record, record.view(np.uint8)
            self._states[k][:] = self._shown_bytes[k]
        return sides

    def _take_time(self, sides: tuple[int, ...], host_ns: int) -> None:
        if self._time.start_ns < 0:
            self._machine.begin(self._plan.mode)
        for k in sides:
            self._time.take(k, self._stamps[k], host_ns)
            if self._own_clocks:
                self._echoes[k].agree(self._time.elapsed_ns[k] > 0)

    def _ask_for_torques(self, sides: tuple[int, ...]) -> QpStatus:
        """Have the controller write what it desires. What it raises ends the session, and the controller."""
        if not self._alone:
            try:
                return self._control(sides)
            except PLUG_INS_RAISE as error:
                self._go_on_alone(error, *self._plug_ins)
        for k in sides:
            sample, control = self._records[k]
            self._echoes[k].desire_nothing_new()
            control["t_ns"] = sample["t_ns"]
            control["mode"] = self._machine.mode
        return QpStatus.NOT_USED

    def _control(self, sides: tuple[int, ...]) -> QpStatus:
        controller, arms, elapsed = self._controller, self._controlled, self._time.elapsed_ns
        for k in sides:
            controller.observe(k, elapsed[k])
        now_ns = self._time.now_ns
        controller.decide(now_ns * 1e-9)
        if self._look_for_an_end(now_ns // TICK_NS):
            return self._ask_for_torques(sides)
        status, source = _NOT_USED, self._plan.source
        for k in sides:
            arm = arms[k]
            if source is not None:
                source.step(k, arm)
            elapsed_ns = elapsed[k]
            found = controller.command(k, elapsed_ns, elapsed_ns // TICK_NS)
            if type(found) is not QpStatus:
                raise TypeError(f"command returned {found!r}, not a QpStatus")
            if found > status:
                status = found
                if found > _SOLVED:
                    self._notes.take_qp(k, arm)
            if self._share < 1.0:
                low_pass(arm.sample, arm.workspace, self._share)
        controller.finish()
        return status

    def _look(self, *times_ns: int) -> None:
        """Look at tracker and sensors; not any more once one of them has raised."""
        if self._blind:
            return
        try:
            self._publisher.look(self._cell.tracker, *times_ns)
        except PLUG_INS_RAISE as error:
            self._blind = True
            self._go_on_alone(error, self._cell.tracker.latest)

    def _go_on_alone(self, error: BaseException, *called: object) -> None:
        """Stop without the controller: it has raised, or what is called beside it has."""
        if self._notes.error is None:
            self._notes.error = error
        self._alone = True
        self._end(WatchdogTrip(End.CONTROLLER_EXCEPTION, raised(error, *called)), "controller")

    def _publish(self, sides: tuple[int, ...], compute_us: float) -> None:
        """Publish once all arms were served; where one was served twice, with the other one's last tick."""
        compute = self._compute_us
        served = _MASK[sides]
        compute[0] = compute_us + (compute[0] if self._unpublished else 0.0)
        complete = served | self._unpublished == self._all_mask
        if complete or (served & self._unpublished and self._time.all_begun):
            self._unpublished = 0
            if self._own_clocks:
                self._look()
            self._publisher.tick(self._records)
        else:
            self._unpublished |= served

    def _look_for_an_end(self, index: int) -> bool:
        """Ask everybody who may end the session. Returns whether the controller must not be asked any more."""
        machine, source = self._machine, self._plan.source
        if machine.mode is _STOPPING:
            return False
        for watchdog in self._watchdogs:
            if source is not None and watchdog is source:
                source.listen()
            trip = watchdog.trip()
            if trip is not None:
                self._end(trip, "watchdog")
                self._alone = trip.end is End.TICK_OVERRUN
                return self._alone
        if self._stop is not None and self._stop.stop_requested:
            self._end(WatchdogTrip(End.STOP_REQUESTED, "", Level.WARNING), "operator")
        elif machine.patience_over:
            patience_s = machine.parameters.impact_patience_s
            self._end(WatchdogTrip(End.NO_IMPACT, f"within {patience_s} s of the nominal impact"))
        elif self._controller.reaction_over and self._controller.monitor is not None:
            monitor = self._controller.monitor
            self._end(WatchdogTrip(End.CRASH if monitor.crash else End.UNEXPECTED_IMPACT, monitor.text))
        elif index >= self._last_index and self._plan.source is None:
            self._end(WatchdogTrip(End.COMPLETED, ""))
        return False

    def _end(self, trip: WatchdogTrip, speaker: str = "") -> None:
        """Stop from now on, for this reason unless there was one before."""
        if self._notes.take(trip, self._time.t_ns, self._time.now_ns):
            self._reporter.let_speak(speaker)
        self._machine.stop()

    def _judge(self, sides: tuple[int, ...], status: QpStatus) -> None:
        """Let the judges see their arms; where one of them stops, the other one's next tick stops too."""
        stopping = self._machine.mode is _STOPPING
        demand = _COMMANDED if stopping else _NO_REASON
        if status > _SOLVED and not stopping:
            demand = _CONTROLLER
        phase = self._phase
        if self._impact_ns <= self._time.now_ns < self._impact_end_ns:
            phase = _CONTACT if self._machine.impact_s < 0.0 else _IMPACT
        for k in sides:
            self._judges[k].expect(phase)
            self._judges[k].judge(self._records[k][0], demand, self._residuals[k])
            self._echoes[k].sent()

    def _look_at_judges(self, status: QpStatus) -> None:
        """Notice a stop of a judge's own, and when all arms stop."""
        for one in self._stopping:
            if one[0]:
                break
        else:
            return
        stopping = [judge.stopping for judge in self._judges]
        if self._machine.mode is not Mode.STOPPING:
            k = next((k for k in self._all if stopping[k] and self._judges[k].reason not in _OF_THE_OTHER), None)
            k = stopping.index(True) if k is None else k
            judge = self._judges[k]
            if judge.reason is Cause.CONTROLLER:
                trip = WatchdogTrip(End.QP, status.name.lower(), side=self._sides[self._notes.qp_side])
            else:
                value, bound = float(judge.memory["value"][0]), float(judge.memory["bound"][0])
                side = self._sides[k]
                detail = f"{side}: {explained(judge, self._records[k][0], self._plug_ins)}"
                trip = WatchdogTrip(End.SAFETY, detail, value=value, bound=bound, side=side, joint=judge.joint)
            self._end(trip, "safety")
        if all(stopping) and self._notes.reaction_ticks is None and self._notes.trip.end.is_fault:
            self._notes.reaction_ticks = round((self._time.now_ns - self._notes.now_ns) / TICK_NS)

    def _at_rest(self) -> bool:
        if not self._rest.over():
            return False
        if not self._rest.reached:
            detail = f"still {self._rest.fastest:.3g} rad/s after {STOP_TICKS} ticks"
            self._end(WatchdogTrip(End.NOT_AT_REST, detail, value=self._rest.fastest, bound=REST_DQ), "safety")
        return True
