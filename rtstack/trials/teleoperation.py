"""Runs a teleoperation on a cell: the session of a demonstration, led by an operator instead of a script."""

import time
from collections.abc import Callable

from hal.cell import Cell
from rtstack.control.modes import Strategy
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.session import SessionPlan
from rtstack.loop.timeline import TICK_NS
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import ForcePhase
from rtstack.samples import Level
from rtstack.teleoperation.guide import TeleoperationGuide
from rtstack.teleoperation.reach import Reach
from rtstack.trials.assembly import Parameters, cell_parameters, following
from rtstack.trials.object import check_object
from rtstack.trials.policy_host import PolicyHost
from rtstack.trials.result import TeleoperationResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.run_observer import RunEvent
from rtstack.trials.scoring import failure_reason
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import limits_of_arms

_AS_WANTED = (End.COMPLETED, End.RELEASED)


def run_teleoperation(
    specification: TeleoperationSpecification,
    description: CellDescription,
    cell: Cell,
    mailbox: Mailbox,
    context: RunContext = NO_CONTEXT,
    *,
    parameters: Parameters | None = None,
    way: StartMotion | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
    host: PolicyHost | None = None,
) -> TeleoperationResult:
    """Follow the mailbox's targets of this job on an open cell until the operator ends it. The log is closed here.

    Before the first target the arms hold where they are. clock: the host's monotonic time, ns, that the clutch's signs
    of life carry. way: gone before the first tick. host: of a policy in this process, which leads from the beginning.
    """
    parameters = parameters or cell_parameters(description)
    check_object(specification.object, description)
    limits = limits_of_arms(description)
    reach = Reach.within(limits[0])
    guide = TeleoperationGuide(mailbox, specification.job, reach, specification.stop_on_release, clock)
    control = parameters.control
    plan = SessionPlan.guided(guide, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)
    longest = 0 if host is None else host.longest_ticks
    with Run(description, parameters, plan, limits, context.with_watchdog(guide), way, longest, [guide]) as run:
        guide.tell = lambda text: run.run_event(RunEvent(Level.INFO, "operator", text))
        if host is not None:
            cameras = None if context.log is None else context.log.cameras
            run.between = host.serve(guide, cell.tracker, description, run.run_event, cameras)
        outcome = run.follow(cell, following(Strategy.PROPOSED), 0.0)
        interventions = outcome.safety_interventions
        cut_off = specification.recorded and guide.lost  # the operator did not end this recording
        end = End.COMPLETED if outcome.end in _AS_WANTED and not cut_off else outcome.end
        reason = failure_reason(end, outcome.detail, interventions)
        result = TeleoperationResult(
            success=reason is None,
            failure_reason=reason,
            object=specification.object,
            seed=specification.seed,
            operator=specification.operator,
            recorded=specification.recorded,
            moved=guide.moved,
            cell=cell.name,
            detected_impact_time_s=run.first_impact_s,
            duration_s=run.history.ticks * TICK_NS * 1e-9,
            missed_deadlines=outcome.missed_deadlines,
            safety_interventions=interventions,
            log=run.log_name,
        )
        return run.finished(result)
