"""The scripted operator: what a number and a speed make of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rtstack.model.arm_model import ArmModel
from rtstack.references.demonstration import end_effector_pose, grab, scripted_targets
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


def test_hands_hold_the_pads_to_the_object_however_home_has_them(cell):
    """Bases that are turned turn the pads at home with them: the faces meet the object's flat all the same."""
    half = np.radians(4.0) / 2.0
    left = replace(cell.left, base_orientation_wxyz=(float(np.cos(half)), 0.0, 0.0, float(np.sin(half))))
    right = replace(cell.right, base_orientation_wxyz=(float(np.cos(half)), float(np.sin(half)), 0.0, 0.0))
    models = ArmModel(left, cell.pad), ArmModel(right, cell.pad)
    homes = np.array([cell.left.home, cell.right.home])
    script = grab(3)
    targets = scripted_targets(script, models, homes, cell.objects["rice_box"], cell.table, 1e-3)
    steady = round(1e3 * (script.rest_s + script.approach_s - script.steady_s + max(script.lag_s)))
    for model, home, side, inward in zip(models, homes, targets, (-1.0, 1.0), strict=True):
        place, rotation = end_effector_pose(model, home)
        assert side["position"][0] == pytest.approx(place)
        assert side["rotation"][0] == pytest.approx(rotation)
        assert np.abs(side["rotation"][steady:, :, 2] - [0.0, inward, 0.0]).max() < 1e-9
        R = Rotation.from_matrix(side["rotation"])
        turning = (R[1:] * R[:-1].inv()).as_rotvec() / 1e-3
        assert turning == pytest.approx(0.5 * (side["twist"][1:, 3:] + side["twist"][:-1, 3:]), abs=1e-5)
