"""The scripted operator: what a number and a speed make of it."""

import numpy as np
import pytest

from rtstack.references.demonstration import grab, scripted_targets
from rtstack.trials.assembly import arm_controllers, default_parameters


def test_variations_differ_and_stay_what_they_are():
    scripts = [grab(variation) for variation in range(10)]
    assert len(set(scripts)) == 10
    assert scripts == [grab(variation) for variation in range(10)]


@pytest.mark.parametrize("speed_m_s", [0.2, 0.35, 0.55])
def test_the_pads_reach_the_surface_at_the_speed_that_was_asked_for(cell, speed_m_s):
    arms = arm_controllers(cell, default_parameters())
    homes = np.array([cell.left.home, cell.right.home])
    box = cell.objects["rice_box"]
    script = grab(1, speed_m_s)
    targets = scripted_targets(script, (arms[0].model, arms[1].model), homes, box, cell.table, 1e-3)
    for side in targets:
        y, v = side["position"][:, 1], side["twist"][:, 1]
        inward = -np.sign(y[0])
        touch = int(np.argmax(np.abs(y) <= box.size[1] / 2))
        steady = slice(touch - round(1e3 * script.steady_s) + 5, touch - 5)
        assert inward * v[steady] == pytest.approx(speed_m_s, rel=1e-6)
