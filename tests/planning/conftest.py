"""One planned grab and one planned push, shared: a plan takes seconds."""

import pytest

from rtstack.model.cell_description import CellDescription
from rtstack.planning import GrabPlan, PlannedMotion, PushPlan, plan_grab, plan_push


@pytest.fixture(scope="session")
def grabbed(cell: CellDescription) -> PlannedMotion:
    """A grab of the rice box, with post-impact velocities 10 % below the map's."""
    return plan_grab(cell, "rice_box", GrabPlan(speed=0.3, rise=0.22, height=0.03, post_impact_scale=0.9))


@pytest.fixture(scope="session")
def pushed(cell: CellDescription) -> PlannedMotion:
    """A push of the box of 1.30 kg."""
    return plan_push(cell, "box_130", PushPlan(speed=0.6))
