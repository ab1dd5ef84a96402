"""A session: one reference followed from its first tick to rest. Teleoperation and trials are the same loop.

The robot is the clock: `read` blocks until the next state. Nothing here sleeps, and nothing after the reads waits.
"""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hal.cell import LEFT, RIGHT, Cell
from hal.errors import HardwareError
from hal.state import ARM_STATE
from rtstack.control.records import WORKSPACE
from rtstack.control.tick import DualArmController
from rtstack.loop.echo import largest_difference
from rtstack.loop.end import End
from rtstack.loop.low_pass import low_pass, low_pass_share
from rtstack.loop.publisher import Publisher
from rtstack.loop.timeline import TICK_NS, Timeline
from rtstack.loop.watchdogs import Watchdog
from rtstack.safety.judge import Reason, SafetyJudge
from rtstack.samples import ARM_SAMPLE, SIDES, Level, Mode, QpStatus

REST_DQ = 0.02  # rad/s: below it for REST_TICKS the arms are at rest
REST_TICKS = 50
SAME_TORQUE_NM = 1e-3  # the wire rounds to float32: 4e-6 Nm at 87 Nm
_FIRST = ((), (0,), (1,), (0,))  # the arm to serve of a mask of LEFT and RIGHT
STOP_TICKS = 1000  # a stop from the velocity limit takes 0.5 s at 10 rad/s^2; after twice that the session ends anyhow


class StopSignal(Protocol):
    """Somebody who may ask for a stop. Read once a tick."""

    @property
    def stop_requested(self) -> bool:
        """Whether a stop is asked for."""
        ...


@dataclass(frozen=True, slots=True)
class Plan:
    """What to follow: ante and post (2, n) of POINT, the mode to begin with, and the stiffness (6,)."""

    ante: NDArray
    post: NDArray
    mode: Mode
    stiffness: NDArray[np.floating]
    period_s: float

    @property
    def ticks(self) -> int:
        """Length of the reference in ticks."""
        return self.ante.shape[1]


@dataclass(frozen=True, slots=True)
class SessionOutcome:
    """end: how it ended; detail: which limit, error or QP status, empty where all went well.

    real_time_factor: robot's seconds over the host's, from the first tick to the last.
    """

    end: End
    detail: str
    start_t_ns: int
    missed_deadlines: int
    safety_interventions: int
    real_time_factor: float


class Session:
    """Runs a plan on a cell. `between_ticks` is called after the answers are out (progress, room in the log).

    cutoff_hz: of the low-pass of the desired torque, 0 for none. watchdogs: asked once a tick, beside `stop`.
    """

    def __init__(
        self,
        cell: Cell,
        controller: DualArmController,
        judges: tuple[SafetyJudge, SafetyJudge],
        publisher: Publisher,
        plan: Plan,
        stop: StopSignal | None = None,
        between_ticks: Callable[[int], None] | None = None,
        cutoff_hz: float = 0.0,
        watchdogs: Sequence[Watchdog] = (),
    ) -> None:
        self._cell = cell
        self._controller = controller
        self._judges = judges
        self._publisher = publisher
        self._plan = plan
        self._stop = stop
        self._between_ticks = between_ticks
        self._watchdogs = tuple(watchdogs)
        self._share = low_pass_share(cutoff_hz)
        if self._share < 1.0:  # compile it before the robot is armed
            low_pass(np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE), self._share)
        self._arms = (cell.left, cell.right)
        for arm in controller.arms:
            arm.pursue(plan.stiffness, arm.parameters.posture_gain)
        self._states = tuple(a.sample.view(np.uint8)[: ARM_STATE.itemsize] for a in controller.arms)
        self._stamps = tuple(a.sample["t_ns"] for a in controller.arms)
        self._torques = tuple(a.sample["tau_applied"][0] for a in controller.arms)
        # what the judge let through last, what the robot says it was, what the controller starts from
        self._torques_known = tuple(
            (judge.memory["tau_applied"][0], a.sample["tau_J_d"][0], a.workspace["tau_previous"][0])
            for judge, a in zip(judges, controller.arms, strict=True)
        )
        self._records = tuple((a.sample, a.control) for a in controller.arms)
        self._residuals = tuple(a.control["momentum_residual"][0] for a in controller.arms)
        self._end = End.COMPLETED
        self._detail = ""
        self._time = Timeline(publisher.timing, cell.own_clocks)
        self._compute_us = publisher.timing["compute_us"]
        self._unpublished = 0
        self._lost = 0
        self._echoed = [False, False]  # the robot has shown a torque of ours
        self._rest = 0
        self._stopping_ticks = 0
        self._mode = Mode.IDLE

    def run(self) -> SessionOutcome:
        """Follow the plan to its end, brake, and leave torque control. Never raises for what a robot does."""
        collecting = gc.isenabled()
        gc.disable()  # a collection in the middle of a tick is a tick that waits
        try:
            self._cell.start()
            while self._tick():
                if self._between_ticks is not None:
                    self._between_ticks(self._time.now_ns // TICK_NS)
        except HardwareError as error:
            self._finish(End.HARDWARE, str(error))
            self._publisher.event(self._time.t_ns, Level.ERROR, "robot", str(error))
        finally:
            for arm in self._arms:
                arm.stop()
            if collecting:
                gc.enable()
        self._controller.machine.rest()
        self._say_mode()
        self._say_link()
        return SessionOutcome(
            end=self._end,
            detail=self._detail,
            start_t_ns=self._time.start_ns,
            missed_deadlines=self._time.missed,
            safety_interventions=sum(judge.interventions for judge in self._judges),
            real_time_factor=self._time.real_time_factor,
        )

    def _tick(self) -> bool:
        """One tick of the arms whose states have arrived. Returns whether to go on."""
        controller = self._controller
        machine = controller.machine
        sides = self._receive()
        began_ns = time.perf_counter_ns()
        self._take_time(sides, began_ns)
        for k in sides:
            controller.arms[k].observe()
        now_ns = self._time.now_ns
        controller.decide(now_ns * 1e-9)
        self._look_for_an_end(now_ns // TICK_NS)
        self._say_mode()
        status = QpStatus.NOT_USED
        for k in sides:
            arm = controller.arms[k]
            arm.choose(self._plan.ante[k], self._plan.post[k], self._time.elapsed_ns[k] // TICK_NS, machine)
            status = max(status, arm.command(machine.mode))
            if self._share < 1.0:
                low_pass(arm.sample, arm.workspace, self._share)
        controller.finish()
        self._judge(sides, status)
        for k in sides:
            self._arms[k].write(self._torques[k])
        self._publish(sides, (time.perf_counter_ns() - began_ns) * 1e-3)
        return not (machine.mode is Mode.STOPPING and 0 in sides and self._at_rest())

    def _receive(self) -> tuple[int, ...]:
        """Read both arms where they share a clock, else one whose state has arrived: the other one's turn is next.

        Answered together, the first one would wait for the second one's tick.
        """
        cell = self._cell
        sides = _FIRST[cell.link.wait()] if cell.own_clocks and cell.link is not None else (0, 1)
        for k in sides:
            self._states[k][:] = self._arms[k].read().record.view(np.uint8)
        return sides

    def _take_time(self, sides: tuple[int, ...], host_ns: int) -> None:
        if self._time.start_ns < 0:
            self._controller.machine.begin(self._plan.mode)
        for k in sides:
            self._time.take(k, self._stamps[k], host_ns)
            if self._cell.own_clocks:
                self._agree_on_the_past(k)

    def _agree_on_the_past(self, k: int) -> None:
        """Start from the torque that the robot has: an answer that came too late was dropped.

        Torque control begins at zero. Until our first torque has come back, tau_J_d is what the robot's own controller
        held the arm with: no start for ours.
        """
        applied, tau_J_d, tau_previous = self._torques_known[k]
        difference = largest_difference(tau_J_d, applied)
        if not SAME_TORQUE_NM < difference < np.inf:  # the same, or no number at all
            self._echoed[k] = self._echoed[k] or self._time.elapsed_ns[k] > 0
            return
        self._lost += self._time.elapsed_ns[k] > 0
        if self._echoed[k]:
            applied[:] = tau_previous[:] = tau_J_d
        else:
            applied[:] = tau_previous[:] = 0.0

    def _publish(self, sides: tuple[int, ...], compute_us: float) -> None:
        """Publish once both arms were served; where one was served twice, with the other one's last tick."""
        compute = self._compute_us
        served = sum(1 << k for k in sides)
        compute[0] = compute_us + (compute[0] if self._unpublished else 0.0)
        both = served | self._unpublished == LEFT | RIGHT
        if both or (served & self._unpublished and self._time.both_begun):
            self._unpublished = 0
            self._publisher.tick(self._records[0], self._records[1], self._cell.tracker)
        else:
            self._unpublished |= served

    def _look_for_an_end(self, index: int) -> None:
        machine = self._controller.machine
        if machine.mode is Mode.STOPPING:
            return
        for watchdog in self._watchdogs:
            trip = watchdog.trip()
            if trip is not None:
                self._finish(trip.end, trip.detail)
                self._publisher.event(self._time.t_ns, trip.level, "watchdog", f"{trip.end}: {trip.detail}")
                return
        if self._stop is not None and self._stop.stop_requested:
            self._finish(End.STOP_REQUESTED, "")
        elif machine.patience_over:
            self._finish(End.NO_IMPACT, f"within {machine.parameters.impact_patience_s} s of the nominal impact")
        elif index >= self._plan.ticks:
            self._finish(End.COMPLETED, "")

    def _finish(self, end: End, detail: str) -> None:
        if self._controller.machine.mode is not Mode.STOPPING:
            self._end = end
            self._detail = detail
            self._controller.machine.stop()

    def _judge(self, sides: tuple[int, ...], status: QpStatus) -> None:
        """Let the judges see their arms; where one of them stops, the other one's next tick stops too."""
        stopping = self._controller.machine.mode is Mode.STOPPING
        demand = Reason.COMMANDED if stopping else Reason.NONE
        if status > QpStatus.SOLVED and not stopping:
            demand = Reason.CONTROLLER
        for k in sides:
            arm = self._controller.arms[k]
            self._judges[k].judge(arm.sample, demand, self._residuals[k])
            arm.applied()
        if not stopping and any(judge.stopping for judge in self._judges):
            self._explain_stop(status)

    def _explain_stop(self, status: QpStatus) -> None:
        side, judge = next((s, j) for s, j in zip(SIDES, self._judges, strict=True) if j.stopping)
        if judge.reason is Reason.CONTROLLER:
            self._finish(End.QP, status.name.lower())
        else:
            self._finish(End.SAFETY, f"{side}: {judge.explanation}")
        self._publisher.event(self._time.t_ns, Level.ERROR, "safety", f"{self._end}: {self._detail}")

    def _at_rest(self) -> bool:
        self._stopping_ticks += 1
        moving = max(float(np.max(np.abs(a.sample["dq"][0]))) for a in self._controller.arms)
        self._rest = self._rest + 1 if moving < REST_DQ else 0
        return self._rest >= REST_TICKS or self._stopping_ticks >= STOP_TICKS

    def _say_mode(self) -> None:
        machine = self._controller.machine
        if machine.mode is self._mode:
            return
        if (
            machine.mode in (Mode.INTERIM, Mode.POST_IMPACT)
            and machine.impact_s >= 0.0
            and self._mode is Mode.ANTE_IMPACT
        ):
            self._publisher.event(
                self._time.t_ns,
                Level.INFO,
                "impact",
                f"detected at {machine.impact_s:.3f} s, {self._controller.impact_arm}",
            )
        self._publisher.event(
            self._time.t_ns, Level.INFO, "mode", f"{self._mode.name.lower()} -> {machine.mode.name.lower()}"
        )
        self._mode = machine.mode

    def _say_link(self) -> None:
        """Where two clocks were served: what the link lost, and how far the clocks drifted apart."""
        if self._cell.own_clocks:
            text = f"{self._lost} answers came too late, {self._time.missed} states missed, "
            text += f"the arms' states were {self._time.skew_ns * 1e-6:g} ms apart at most"
            self._publisher.event(self._time.t_ns, Level.INFO, "link", text)
