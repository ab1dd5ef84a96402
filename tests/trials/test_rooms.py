"""How far an object can be shifted, as forms say it: what a simulated trial begins with, and no more."""

import pytest

from hal.displacement import Displacement
from rtstack.cells.description import load_description
from rtstack.trials.start_motion import rooms_mm
from sim_robot.cell import simulated_cell
from sim_robot.scene import ObjectOutOfReach


@pytest.mark.parametrize("name", ["rice_box", "bottles"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_form_takes_what_a_start_takes(name, axis):
    for end, further in zip(rooms_mm(load_description(None)[0])[name][axis], (-1.0, 1.0), strict=True):
        at, beyond = (Displacement.given(*((0.0, mm) if axis == 0 else (mm, 0.0))) for mm in (end, end + further))
        simulated_cell(name, at, 0).close()
        with pytest.raises(ObjectOutOfReach, match=f"allowed are .*{abs(end)}"):
            simulated_cell(name, beyond, 0)
