"""Two arms grip the rice box, lift it and hold it: the contact as the controller will meet it."""

from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_robot.cell import simulated_cell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.plant_object import object_pose
from tests.support.spring_grip import SpringGrip


def test_the_box_is_lifted_and_does_not_creep() -> None:
    cell = simulated_cell("rice_box", 0.01, seed=3)
    weight = load_scene().objects["rice_box"].mass * 9.81
    grip = SpringGrip(cell, press_n=35.0)
    grip.run(3.5)
    held = grip.run(3.0)
    assert held[0, 2] == pytest.approx(0.4, abs=0.01)
    assert np.linalg.norm(held[-1] - held[0]) < 2e-3
    # what the robot reports of it: a squeeze of equal and opposite forces, and half of the weight each
    wrenches = cell.states["O_F_ext_hat_K"]
    assert wrenches[0, 1] == pytest.approx(-wrenches[1, 1], abs=2.0)
    assert -45.0 < wrenches[0, 1] < -25.0
    assert wrenches[:, 2].sum() == pytest.approx(weight, rel=0.05)


def test_the_pads_are_as_stiff_as_the_scene_says() -> None:
    """At rest, force over penetration is the series of pad and wall, within 5 %."""
    cell = simulated_cell("rice_box", 0.0, seed=3)
    SpringGrip(cell, press_n=35.0).run(1.45)
    data, model = cell.plant.data, cell.plant.model
    pad = model.geom("left_pad").id
    points = [i for i, c in enumerate(data.contact) if pad in (c.geom1, c.geom2)]
    assert len(points) == 4
    penetration = -np.mean([data.contact[i].dist for i in points])
    force = np.abs(cell.states["O_F_ext_hat_K"][0, 1])
    scene = load_scene()
    expected = 1.0 / (1.0 / scene.pad.stiffness + 1.0 / scene.objects["rice_box"].stiffness)
    assert force / penetration == pytest.approx(expected, rel=0.05)


def test_a_grip_that_is_too_weak_leaves_the_box_on_the_table() -> None:
    """Friction is finite: two pads at 4 N carry 7 N of the box's 12."""
    cell = simulated_cell("rice_box", 0.0, seed=3)
    start = object_pose(cell.plant)[0]
    lifted = SpringGrip(cell, press_n=4.0).run(3.0)
    pads = cell.plant.data.xpos[[cell.plant.model.body(f"{side}_pad").id for side in ("left", "right")]]
    assert pads[:, 2].min() > start[2]
    assert lifted[-1, 2] == pytest.approx(start[2], abs=1e-3)


def gripped(jacobian: mujoco.mjtJacobian, disturbance: int | None = None) -> np.ndarray:
    """Return positions and velocities of a grip and a lift, ms by ms, with MuJoCo's solver on such a Jacobian.

    disturbance: the seed of velocities of 1e-16 m/s and rad/s that it begins with, None for none.
    """
    cell = simulated_cell("rice_box", -0.03, seed=3)
    cell.plant.model.opt.jacobian = jacobian
    if disturbance is not None:
        velocities = cell.plant.data.qvel
        velocities += 1e-16 * np.random.default_rng(disturbance).standard_normal(len(velocities))
    grip, data = SpringGrip(cell, press_n=35.0), cell.plant.data
    states = []
    for _ in range(2000):
        grip.run(1e-3)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


@pytest.mark.parametrize("scene", ["grab", "platform"])
def test_no_scene_uses_a_sparse_jacobian(scene: str) -> None:
    """MuJoCo 4.0.0's Newton solver has a wrong Hessian for sparse ones (mujoco#3767)."""
    layout = load_scene(Path(str(files("sim_robot") / "scenes" / f"{scene}.toml")))
    plant = Plant.nominal(layout, load_plant_parameters(), next(iter(layout.objects)))
    assert plant.model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
    assert not mujoco.mj_isSparse(plant.model)


def test_a_dense_jacobian_is_what_mujoco_chose_and_a_sparse_one_gives_the_same_grip() -> None:
    """Contacts slide, stick and are lost again on the way, and rounding grows: how far differs from CPU to CPU, so
    what the last bits of the start become is measured beside it."""
    dense = gripped(mujoco.mjtJacobian.mjJAC_DENSE)
    assert np.array_equal(gripped(mujoco.mjtJacobian.mjJAC_AUTO), dense)
    sparse = gripped(mujoco.mjtJacobian.mjJAC_SPARSE)
    assert not np.array_equal(sparse, dense)  # it is another solver
    rounding = max(np.abs(gripped(mujoco.mjtJacobian.mjJAC_DENSE, seed) - dense).max() for seed in range(3))
    assert rounding < 1e-7  # m, rad, m/s and rad/s
    assert np.abs(sparse - dense).max() < 10.0 * rounding
