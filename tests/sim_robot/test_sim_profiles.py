"""The profiles of the simulated robot: each effect alone, as a client can see it, and nothing where the number is 0."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.robots import FR3
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.profile import BOX_DRAW, Profile, Spread, load_profile, profile_names
from sim_robot.scene import load_scene

IDEAL, HONEST = load_profile("ideal"), load_profile("honest")
SCENE, NOMINAL = load_scene(), load_plant_parameters().nominal()


def _cell(profile: Profile, seed: int = 0, arms_seed: int | None = None) -> SimulatedCell:
    """A cell that differs from a nominal one by its profile alone."""
    plant = Plant(SCENE, NOMINAL, "rice_box", 0.0, seed, arms_seed, profile=profile)
    return SimulatedCell(plant, SCENE, NOMINAL, seed)


def _forces(cell: SimulatedCell, ms: int) -> Iterator[np.ndarray]:
    for _ in range(ms):
        yield cell.left.read().tau_ext_hat_filtered.copy()


def test_the_profiles_and_an_unknown_one():
    assert profile_names() == ("ideal", "harsh", "honest")
    with pytest.raises(ConfigurationError, match="unknown profile 'kind'; there is ideal, harsh, honest"):
        load_profile("kind")


def test_an_honest_force_estimate_is_biased_by_some_2_N_and_a_harsh_one_by_more():
    def at_rest(name: str) -> float:
        cells = [simulated_cell("rice_box", 0.0, seed, profile=name) for seed in range(6)]
        means = [np.mean([cell.left.read().O_F_ext_hat_K[:3] for _ in range(300)], axis=0) for cell in cells]
        return float(np.median(np.linalg.norm(means, axis=1)))

    ideal, honest, harsh = (at_rest(name) for name in ("ideal", "honest", "harsh"))
    assert ideal < 0.3
    assert 1.0 < honest < 3.0 < harsh < 10.0


def test_the_bias_is_the_arms_and_depends_on_its_pose():
    force = replace(IDEAL.force, gravity_error=0.02)
    at_home = list(_forces(_cell(replace(IDEAL, force=force), seed=1, arms_seed=7), 200))[-1]
    again = list(_forces(_cell(replace(IDEAL, force=force), seed=2, arms_seed=7), 200))[-1]
    assert np.allclose(at_home, again, atol=1e-3)  # another run of the same arm
    other = list(_forces(_cell(replace(IDEAL, force=force), seed=1, arms_seed=8), 200))[-1]
    assert np.abs(at_home - other).max() > 0.1
    left = replace(
        SCENE.left, home=(0.0, 0.0, 0.0, -0.4, 0.0, 0.6, 0.0)
    )  # stretched upwards: no gravity to be wrong about
    scene = replace(SCENE, left=left)
    plant = Plant(scene, NOMINAL, "rice_box", 0.0, 1, 7, profile=replace(IDEAL, force=force))
    upright = list(_forces(SimulatedCell(plant, scene, NOMINAL, 1), 200))[-1]
    assert np.abs(upright).max() < 0.5 * np.abs(at_home).max()


def test_a_payload_that_the_robot_was_not_told_of_pulls_the_pad_down():
    cell = _cell(replace(IDEAL, force=replace(IDEAL.force, payload_error_kg=0.2)), seed=3)
    states = [cell.left.read().O_F_ext_hat_K.copy() for _ in range(400)]
    kg = cell.plant.estimate_errors[0].payload_kg
    # positive where the robot pushes the environment; the load sits some centimetres before the pad's face
    assert abs(kg) > 0.05
    assert states[-1][2] == pytest.approx(-9.81 * -kg, abs=0.25 * abs(9.81 * kg))


def test_the_estimate_is_late_by_whole_milliseconds():
    pushed = []
    for delay_ms in (0, 5):
        cell = _cell(replace(IDEAL, force=replace(IDEAL.force, delay_ms=delay_ms)))
        list(_forces(cell, 100))
        cell.plant.push(0, np.array([0.0, 0.0, -20.0]))
        pushed.append(np.array(list(_forces(cell, 100))))
    assert np.allclose(pushed[1][5:], pushed[0][:-5], atol=1e-6)
    assert np.abs(pushed[1][:5]).max() < 0.1


def test_the_slow_noise_has_its_size_and_is_slow():
    force = replace(IDEAL.force, noise=(0.2,) * 7, noise_hz=2.0)
    tau = np.array(list(_forces(_cell(replace(IDEAL, force=force), seed=5), 4000)))
    tau -= np.array(list(_forces(_cell(IDEAL, seed=5), 4000)))
    assert 0.1 < tau.std(axis=0).mean() < 0.3
    assert np.abs(np.diff(tau, axis=0)).max() < 0.2


def test_the_arm_has_a_urdf_of_its_own_with_the_same_joints():
    own, ideal = _cell(HONEST, seed=2).plant.robots[0], _cell(IDEAL, seed=2).plant.robots[0]
    assert ideal is FR3
    assert own.urdf != FR3.urdf
    assert own.limits is FR3.limits
    assert own.urdf.count("<joint") == FR3.urdf.count("<joint")
    assert _cell(HONEST, seed=2).plant.robots[0].urdf == own.urdf


def test_a_tracker_of_its_own_clock_is_late_and_loses_frames():
    clock = replace(IDEAL.tracker, offset_ms=10.0, latency_ms=(6.0, 8.0, 12.0), lost_share=0.2, lost_frames=5)
    cell = _cell(replace(IDEAL, tracker=clock), seed=4)
    stamps, ages = [], []
    for _ in range(8000):
        t_ns = cell.left.read().t_ns
        pose = cell.tracker.latest()
        if pose.record["seen"][0] and (not stamps or pose.t_ns != stamps[-1]):
            stamps.append(pose.t_ns)
            ages.append(1e-6 * (t_ns - pose.t_ns))
    assert np.all(np.diff(stamps) > 0)
    assert len(stamps) == pytest.approx(0.8 * 2000, rel=0.05)
    assert max(ages) - min(ages) < 8.0  # the offset, once for the run, and 6 to 13 ms on the way
    assert any(abs(age) > 13.0 or age < 6.0 for age in ages)


def test_a_spread_keeps_its_range_and_its_usual_value():
    generator = np.random.default_rng(BOX_DRAW)
    drawn = np.array([Spread(700.0, 1500.0, 7300.0).draw(generator) for _ in range(4000)])
    assert 700.0 <= drawn.min() < 900.0 < 5000.0 < drawn.max() <= 7300.0
    assert 1400.0 < np.exp(np.log(drawn).mean()) < 2600.0
    assert Spread(0.0, 0.0, 0.0).draw(generator) == 0.0
    with pytest.raises(ValueError, match="0 < least <= usual <= most"):
        Spread(5.0, 3.0, 9.0)
