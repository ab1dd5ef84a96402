"""The smallest motion that there is: both arms hold where they are, under the whole loop."""

from contextlib import nullcontext
from typing import cast

import numpy as np

from hal.base.realtime import realtime_thread
from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.control.modes import Strategy
from rtstack.control.records import POINT
from rtstack.control.tick import CellController
from rtstack.loop.end import End
from rtstack.loop.plan import SessionPlan
from rtstack.loop.publisher import Publisher
from rtstack.loop.session import Session
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import ForcePhase
from rtstack.samples import Mode
from rtstack.trials.assembly import cell_controller, default_parameters, following, safety_judges

TICKS = 60


def hold(cell: Cell, description: CellDescription) -> None:
    """Hold both arms for some ticks. Raises HardwareError where the session does not come to its end."""
    parameters = default_parameters()
    controller = cast(CellController, cell_controller(description, parameters, following(Strategy.PROPOSED), 0.0))
    points = np.zeros((2, TICKS), POINT)
    for side, (arm, robot) in enumerate(zip(controller.arms, cell.arms, strict=True)):
        arm.sample["q"][0] = robot.read().q
        arm.observe()
        work = arm.workspace[0]
        points[side]["position"], points[side]["rotation"] = work["position"], work["rotation"]
        points[side]["xi"] = arm.sample["q"][0, parameters.control.posture_joint]
    plan = SessionPlan(
        points, points, Mode.TELEOPERATION, parameters.control.stiffness_teleoperation, parameters.control.period_s,
        phase=ForcePhase.CONTACT,  # after a fault in a grab the pads still press on the object
    )  # fmt: skip
    with realtime_thread() if cell.own_clocks else nullcontext():
        outcome = Session(cell, controller, safety_judges(description), Publisher([], None), plan).run()
    if outcome.end is not End.COMPLETED:
        raise HardwareError(f"{outcome.end}: {outcome.detail}")
