"""Runs a scripted demonstration on a cell, through the teleoperation path, and writes its log."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from hal.cell import Cell
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.references.demonstration import Grab, grab, scripted_targets
from rtstack.safety.limits import ForcePhase
from rtstack.samples import Mode
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters, with_law
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.move import settle_load
from rtstack.trials.object import check_object, check_two_arms
from rtstack.trials.result import DemonstrationResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.scoring import SuccessCriterion, score
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import limits_of_arms

HELD_AFTER_S = 0.2  # the impact
APART_M = 0.05  # ours: a tracker and a calibration are off by 5 mm at most, and an object tilts between the pads


@dataclass(frozen=True, slots=True)
class PreparedDemonstration(PreparedRun[DemonstrationResult]):
    """A demonstration of an object that the cell has."""

    specification: DemonstrationSpecification

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> DemonstrationResult:
        return run_demonstration(self.specification, self.description, cell, context, way=way)


def prepare_demonstration(
    specification: DemonstrationSpecification, description: CellDescription
) -> PreparedDemonstration:
    """Check the object and the arms. Raises TrialError with one line."""
    check_object(specification.object, description)
    check_two_arms(description, "a demonstration of a grab")
    return PreparedDemonstration(specification, description)


def run_demonstration(
    specification: DemonstrationSpecification, description: CellDescription, cell: Cell,
    context: RunContext = NO_CONTEXT, *, parameters: Parameters | None = None, script: Grab | None = None,
    way: StartMotion | None = None,
) -> DemonstrationResult:  # fmt: skip
    """Run a scripted demonstration on an open cell. Closes the log, not the cell. script: in the place of the
    specification's variation. way: the motion to home, carried out before the first tick."""
    prepare_demonstration(specification, description)
    parameters = with_law(parameters or cell_parameters(description), specification.law_inertia)
    arms = arm_controllers(description, parameters)
    period_s = parameters.control.period_s
    targets = scripted_targets(
        script
        or grab(specification.variation, specification.speed_m_s, specification.squeeze_m, specification.squeeze_s),
        (arms[0].model, arms[1].model),
        description.home,
        description.objects[specification.object],
        description.table,
        period_s,
    )
    stiffness = parameters.control.stiffness_teleoperation
    plan = SessionPlan(targets, targets, Mode.TELEOPERATION, stiffness, period_s, phase=ForcePhase.CONTACT)
    with Run(description, parameters, plan, limits_of_arms(description), context, way) as run:
        outcome = run.follow(cell, settle=partial(settle_load, description, specification.object, context))
        impact_s, columns, reason = run.first_impact_s, run.history.columns(), outcome.problem
        values = score(columns, outcome.start_t_ns, impact_s or 0.0, 0.0, impact_s, SuccessCriterion())
        if reason is None and impact_s is None:
            reason = "no impact was detected"
        elif reason is None and impact_s is not None:
            held_ns = outcome.start_t_ns + round(1e9 * (impact_s + HELD_AFTER_S))
            reason = _apart(columns, description, specification.object, held_ns)
        return run.finished(
            DemonstrationResult, reason, specification, values, outcome, detected_impact_time_s=impact_s
        )


def _apart(columns: Columns, description: CellDescription, name: str, t_ns: int) -> str | None:
    """Return in one line where a pad is not at the object that it holds at this robot's time, by bases and tracker."""
    seen = columns.object[(columns.object["seen"] > 0) & (columns.object["t_ns"] <= t_ns)]
    if not len(seen):
        return None
    place, half = seen["position"][-1], np.array(description.objects[name].size) / 2.0
    for k, (side, base) in enumerate(zip(description.sides, base_poses(description), strict=True)):
        now = max(0, int(np.searchsorted(columns.arm["t_ns"][k], t_ns)) - 1)
        face = (base @ columns.arm["O_T_EE"][k, now])[:3, 3]
        away = np.abs(face - place) - half
        if max(away[0], abs(away[1]), away[2]) > APART_M:
            at, there = (", ".join(f"{1e3 * metres:.0f}" for metres in each) for each in (face, place))
            return (
                f"the {side} pad holds the object at ({at}) mm by the cell's file, and the tracker shows it at"
                f" ({there}) mm: measure bases and tracker again (rtstack calibrate)"
            )
    return None
