"""One hit as a run of a one-arm cell: the monitor in the tick switches the references at the impact that it sees."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive
from hal.cell import Cell
from hal.compilation import bound, compiled
from rtstack.control.modes import Strategy
from rtstack.control.tick import CellController
from rtstack.control.watch import UNTIL_BEFORE_S
from rtstack.loop.end import End
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.loop.session import SessionOutcome
from rtstack.loop.standstill import STOP_TICKS
from rtstack.loop.timeline import TICK_NS
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.monitor import Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict
from rtstack.monitor.step import monitor_step
from rtstack.papers.aim_aware.platform.plan import PERIOD_S, HitPlan
from rtstack.samples import Mode
from rtstack.trials.assembly import ControllerRequest, Parameters, arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.result import Result
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import HitSpecification
from rtstack.trials.start_motion import StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms

Six = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
_STOPPING = Mode.STOPPING  # looked up once: an enumeration's member costs 0.1 us

# what a tick leaves: time ns since the first one; rad, rad/s; residual Nm; the pad's face m, m/s and rad/s; torque Nm;
# post: 1 once the references have switched
TICK = np.dtype([
    ("t_ns", "i8"), ("q", "f8", 7), ("dq", "f8", 7), ("residual", "f8", 7),
    ("position", "f8", 3), ("twist", "f8", 6), ("tau_d", "f8", 7), ("post", "i8"),
])  # fmt: skip


@checked(frozen=True, slots=True, config=STRICT)
class HitGains:
    """Stiffness (6,) N/m, Nm/rad before and after the impact; 0: no damping either. posture: 1/s^2."""

    stiffness: Six
    pressing: Six
    posture: Positive


@dataclass(frozen=True, slots=True)
class Hit(Result):
    """ticks (n,) of TICK; stopped: why it ended before its plan, empty if not; missed_deadlines: late cycles."""

    ticks: NDArray[np.void]
    stopped: str
    missed_deadlines: int


@compiled
def watch(states, parameters, dq_post, samples, controls, t_ns):
    """Let the monitor see a tick, t_ns after the first one; return whether this tick is one of an impact (9).

    states, parameters: see monitor_step; dq_post (n, 7): the joint velocities (14), rad/s. samples, controls (1,): of
    the arm; controls[0] gets the verdict.
    """
    state, sample, control = states[0], samples[0], controls[0]
    dq_ref = dq_post[min(t_ns // TICK_NS, dq_post.shape[0] - 1)]
    monitor_step(states, parameters, t_ns, control.momentum_residual, sample.q, sample.dq, dq_ref)
    control.impact_verdict, control.impact_reason, control.impact_margin = state.verdict, state.reason, state.margin
    return state.impact != 0


class HitController(CellController):
    """One arm, whose mode switches in the tick in which the monitor sees the first impact (9)."""

    def __init__(self, plan: HitPlan, monitoring: MonitorParameters, request: ControllerRequest) -> None:
        super().__init__(request.arms, request.modes(Strategy.NO_INTERIM))
        (arm,) = self.arms
        monitor = Monitor(monitoring)
        monitor.expect(round(plan.t_d_s * 1e9), plan.q_d)
        self._watch = bound(watch, monitor.state, monitor.parameters, plan.dq_post, arm.sample, arm.control, later=(0,))

    def watch(self, side: int, elapsed_ns: int) -> None:
        """Take the monitor's impact in the place of the force detector's; see CellController."""
        self.arms[side].impact = self.machine.mode is not _STOPPING and self._watch(elapsed_ns)


def hit_parameters(description: CellDescription, gains: HitGains, plan: HitPlan) -> Parameters:
    """Return the cell's parameters with the gains of a hit. Without an impact a hit goes on to the end of its plan."""
    parameters = cell_parameters(description)
    control = replace(
        parameters.control, stiffness=np.array(gains.stiffness), stiffness_after_impact=np.array(gains.pressing),
        posture_gain=gains.posture, impact_patience_s=len(plan.ante) * PERIOD_S,
    )  # fmt: skip
    return replace(parameters, control=control)


@dataclass(frozen=True, slots=True)
class PreparedHit(PreparedRun[Hit]):
    """A hit along a plan, for `until` ticks at most. From the impact that the monitor sees, (9), on the pad presses
    down.

    The judge has the cell's limits; an impact is meant from UNTIL_BEFORE_S before the planned one on.
    """

    specification: HitSpecification
    gains: HitGains
    plan: HitPlan
    monitoring: MonitorParameters
    until: int | None = None

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: to the start of the plan."""
        return start_motion(cell, self.description, self.specification.object, start=self.plan.ante[:1])

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> Hit:
        plan, description = self.plan, self.description
        pressed_s = (len(plan.ante) + STOP_TICKS) * PERIOD_S  # the pad still presses while the arm comes to rest
        session_plan = SessionPlan(
            plan.ante[None, : self.until], plan.post[None, : self.until], Mode.ANTE_IMPACT,
            np.array(self.gains.stiffness), PERIOD_S, impact_s=(plan.t_d_s - UNTIL_BEFORE_S, pressed_s),
        )  # fmt: skip
        parameters = hit_parameters(description, self.gains, plan)
        with Run(description, parameters, session_plan, limits_of_arms(description), context, way) as run:
            outcome = run.follow(cell, partial(HitController, plan, self.monitoring), plan.t_d_s)
            columns = run.history.columns()
            ticks = ticks_of(columns, description, parameters, outcome.end)
            result = _result(outcome, columns, run)
            incomplete = run.close(result)
        reason = result["failure_reason"] or incomplete
        followed = outcome.end is End.COMPLETED or len(ticks) == session_plan.ticks
        stopped = "" if followed else outcome.detail or str(outcome.end)
        return Hit(reason is None, reason, ticks, stopped, outcome.missed_deadlines)


def ticks_of(columns: Columns, description: CellDescription, parameters: Parameters, end: End) -> NDArray[np.void]:
    """Return the ticks (n,) of TICK in which a hit's references were followed, of its run's samples and end."""
    (arm,) = arm_controllers(description, parameters)
    mode = columns.control[0]["mode"]
    following = (mode == Mode.ANTE_IMPACT) | (mode == Mode.POST_IMPACT)
    samples, control = columns.arm[0][following], columns.control[0][following]
    ticks = np.zeros(len(samples), TICK)
    if len(ticks):
        ticks["t_ns"] = samples["t_ns"] - samples["t_ns"][0]
    ticks["q"], ticks["dq"], ticks["tau_d"] = samples["q"], samples["dq"], samples["tau_applied"]
    ticks["residual"], ticks["post"] = control["momentum_residual"], control["mode"] == Mode.POST_IMPACT
    for tick in ticks:
        work = arm.observed_at(tick["q"], tick["dq"])
        tick["position"], tick["twist"] = work["position"], work["twist"]
    return ticks[:-1] if end in (End.SAFETY, End.QP) else ticks  # the last one's torque was the judge's


def _result(outcome: SessionOutcome, columns: Columns, run: Run) -> dict[str, Any]:
    reason = outcome.problem
    last = columns.control[0][-1] if columns.control.shape[1] else np.zeros(1, columns.control.dtype)[0]
    return {
        "success": reason is None, "failure_reason": reason, "detected_impact_time_s": run.first_impact_s,
        "impact_verdict": Verdict(int(last["impact_verdict"])).name.lower(),
        "impact_reason": Reason(int(last["impact_reason"])).name.lower(),
        "impact_margin": float(last["impact_margin"]), "safety_interventions": outcome.safety_interventions,
        "missed_deadlines": outcome.missed_deadlines,
    }  # fmt: skip
