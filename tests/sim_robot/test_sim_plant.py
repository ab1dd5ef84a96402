"""The plant against independent models: rigid dynamics, a plain Python loop, energy, and itself."""

import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from math import exp
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_robot.cell import simulated_cell
from sim_robot.plant import Plant, SimulationDiverged
from sim_robot.plant_parameters import ZEROS, load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.nominal_cell import frictionless, nominal_cell
from tests.support.rigid_arm import RigidArm

SCENE = load_scene()
PARAMETERS = load_plant_parameters()
NO_TORQUE = np.zeros(7)


@pytest.mark.parametrize("joint", range(7))
def test_a_torque_step_accelerates_the_arm_as_the_rigid_model_predicts(joint: int) -> None:
    """The slope of dq over 100 to 200 ms, when the joints' oscillation has died out, within 1 %."""
    plant = Plant.nominal(SCENE, frictionless(PARAMETERS), "rice_box")
    arm, B_theta = RigidArm(SCENE.pad), np.array(PARAMETERS.joints.B_theta)
    tau = np.where(np.arange(7) == joint, 0.2 if joint > 3 else 1.0, 0.0)
    q, dq = np.array(SCENE.left.home), np.zeros(7)
    plant.command(0, tau)
    velocity, rigid_velocity = [], []
    for _ in range(200):
        plant.advance()
        velocity.append(plant.data.qvel[:7].copy())
        for _ in range(2):
            middle = dq + 0.25e-3 * arm.acceleration(q, dq, tau, B_theta)
            dq = dq + 0.5e-3 * arm.acceleration(q + 0.25e-3 * dq, middle, tau, B_theta)
            q = q + 0.5e-3 * dq
        rigid_velocity.append(dq)
    time_s = np.arange(100, 200) * 1e-3
    slope = np.polyfit(time_s, np.array(velocity)[100:], 1)[0]
    expected = np.polyfit(time_s, np.array(rigid_velocity)[100:], 1)[0]
    assert np.linalg.norm(slope - expected) < 0.01 * np.linalg.norm(expected)


def test_geoms_that_are_left_out_change_nothing() -> None:
    """To the last bit: arms that meet the object, the table and each other, and an object that is put elsewhere."""
    plants = [Plant(SCENE, PARAMETERS, "rice_box", 0.0, 5) for _ in range(2)]
    plants[0].near["fixed"] = 1
    home, met, looked = np.array([SCENE.left.home, SCENE.right.home]), set(), set()
    for ms in range(2500):
        # the first joints bring the pads together, then the second ones bring the arms down
        turned = 0.4 * np.sin(2e-3 * ms)
        for plant in plants:
            for side in range(2):
                goal = home[side] + np.array([turned * (2 * side - 1), 0.3 * (ms > 1200), 0, 0, 0, 0, 0])
                plant.track(side, goal, NO_TORQUE)
            if ms == 2000:
                plant.data.qpos[14:17] += (0.0, 0.0, 0.2)
            plant.advance()
        met |= {tuple(pair) for pair in plants[0].data.contact.geom.tolist()}
        looked.add(int((plants[1].model.geom_contype != 0).sum()))
        assert np.array_equal(plants[0].data.qpos, plants[1].data.qpos), ms
        assert np.array_equal(plants[0].data.contact.dist, plants[1].data.contact.dist), ms
        assert plants[0].motors.tobytes() == plants[1].motors.tobytes(), ms
    assert len(met) > 3
    assert len(looked) > 3  # and by then others than before


def python_millisecond(plant: Plant) -> None:
    """One millisecond of the plant in plain Python, from the paper's equations."""
    data, joints, motors = plant.data, plant.joints, plant.motors
    gravity = np.zeros((2, 7))
    for arm, side in enumerate(("left", "right")):
        for j in range(7):
            body = plant.model.body(f"{side}_link{j + 1}").id
            rx, ry, _ = data.subtree_com[body] - data.xanchor[7 * arm + j]
            lever = data.xaxis[7 * arm + j, 0] * ry - data.xaxis[7 * arm + j, 1] * rx
            gravity[arm, j] = joints["gravity_factor"][arm, j] * 9.81 * plant.model.body_subtreemass[body] * lever
    for _ in range(4):
        tau_t = np.zeros((2, 7))
        for arm in range(2):
            dof = slice(7 * arm, 7 * arm + 7)
            motor, joint = motors[arm], joints[arm]
            tau_t[arm] = joint["K"] * (motor["theta"] - data.qpos[dof]) + joint["D"] * (
                motor["dtheta"] - data.qvel[dof]
            )
            data.qfrc_applied[dof] = tau_t[arm]
        mujoco.mj_step(plant.model, data)
        for arm in range(2):
            motor, p = motors[arm], joints[arm]
            for j in range(7):
                theta, dtheta = motor["theta"][j], motor["dtheta"][j]
                tau_d = motor["tau_command"][j]
                if motor["holding"]:
                    tau_d = p["hold_stiffness"][j] * (motor["theta_hold"][j] - theta)
                    tau_d -= p["hold_damping"][j] * dtheta
                    tau_d = max(-p["hold_tau_max"][j], min(p["hold_tau_max"][j], tau_d))
                tau_d = tau_d + gravity[arm, j]
                p1, p2, p3 = p["friction_p1"][j], p["friction_p2"][j], p["friction_p3"][j]
                tau_fric = p["friction_offset"][j] - p1 / (1.0 + exp(-p2 * (dtheta + p3)))
                ratio = p["B"][j] / p["B_theta"][j]
                tau_act = ratio * tau_d + (1.0 - ratio) * tau_t[arm, j]
                motor["dtheta"][j] = dtheta + 0.25e-3 * (tau_act - tau_t[arm, j] + ratio * tau_fric) / p["B"][j]
                motor["theta"][j] += 0.25e-3 * motor["dtheta"][j]


def test_the_compiled_substeps_equal_a_plain_python_loop_bit_for_bit() -> None:
    compiled, plain = (Plant(SCENE, PARAMETERS, "rice_box", 0.01, seed=4) for _ in range(2))
    generator = np.random.default_rng(0)
    for tick in range(200):
        if tick > 50:
            tau = generator.uniform(-3.0, 3.0, 7)
            compiled.command(0, tau)
            plain.command(0, tau)
        compiled.advance()
        python_millisecond(plain)
    for name in ("qpos", "qvel", "qfrc_constraint"):
        assert np.array_equal(getattr(compiled.data, name), getattr(plain.data, name)), name
    for name in ("theta", "dtheta"):
        assert np.array_equal(compiled.motors[name], plain.motors[name]), name


def test_without_friction_damping_and_gravity_the_energy_stays() -> None:
    """1 s of free motion with ringing joints: kinetic, elastic and motor energy drift below 0.1 %."""
    joints = replace(frictionless(PARAMETERS).joints, D=ZEROS)
    plant = Plant.nominal(SCENE, replace(PARAMETERS, joints=joints), "rice_box")
    plant.model.opt.gravity[:] = 0.0
    plant.joints["gravity_factor"] = 0.0
    for side in range(2):
        plant.command(side, NO_TORQUE)
        plant.motors[side]["theta"] = plant.data.qpos[7 * side : 7 * side + 7]
    plant.data.qvel[:7] = (0.2, -0.2, 0.2, 0.1, 0.3, 0.3, 0.4)

    def energy() -> float:
        mujoco.mj_energyVel(plant.model, plant.data)
        q, m, p = plant.data.qpos[:14].reshape(2, 7), plant.motors, plant.joints
        motor = 0.5 * np.sum(p["B_theta"] * m["dtheta"] ** 2 + p["K"] * (m["theta"] - q) ** 2)
        return float(plant.data.energy[1] + motor)

    mujoco.mj_forward(plant.model, plant.data)
    energies = []
    for _ in range(1000):
        energies.append(energy())
        plant.advance()
    windows = np.array(energies).reshape(10, 100).mean(axis=1)
    assert windows[0] > 0.1
    assert np.abs(windows / windows[0] - 1.0).max() < 0.001


def oscillation(tau_J: np.ndarray) -> float:
    """Largest deviation of any joint's torque from its straight line, Nm; tau_J (n, 7)."""
    time = np.arange(len(tau_J))
    line = np.polyfit(time, tau_J, 1)
    return float(np.abs(tau_J - np.outer(time, line[0]) - line[1]).max())


@pytest.mark.parametrize("kind", ["torque", "force"])
def test_an_impulse_rings_in_the_joint_torque_and_has_died_out_after_100_ms(kind: str) -> None:
    plant = Plant.nominal(SCENE, PARAMETERS, "rice_box")
    plant.command(0, NO_TORQUE)
    tau_J = []
    for tick in range(150):
        if kind == "torque":
            plant.command(0, np.array([5.0, 5.0, 5.0, 5.0, 2.0, 2.0, 2.0]) * (tick < 5))
        else:
            plant.push(0, np.array([20.0, 100.0, 20.0]) * (tick < 5))
        plant.advance()
        tau_J.append(plant.motors["tau_J"][0].copy())
    early, late = oscillation(np.array(tau_J[5:30])), oscillation(np.array(tau_J[105:130]))
    assert early > 1.0
    assert late < 0.05 * early


def run_digest(seed: int, milliseconds: int = 500) -> str:
    """Digest of every state and every tracked pose of a run in which both arms move."""
    cell = simulated_cell("rice_box", 0.01, seed)
    digest = sha256()
    for tick in range(milliseconds):
        for arm in (cell.left, cell.right):
            state = arm.read()
            digest.update(state.record.tobytes())
            arm.write(np.sin(0.01 * tick) * np.array([2.0, 2.0, 2.0, 2.0, 0.5, 0.5, 0.5]))
        digest.update(cell.tracker.latest().record.tobytes())
    return digest.hexdigest()


def test_a_seed_names_a_run_bit_for_bit_in_another_process_too() -> None:
    digest = run_digest(7)
    assert run_digest(7) == digest
    assert run_digest(8) != digest
    script = (
        "from tests.sim_robot.test_sim_plant import run_digest;"
        "from sim_robot.substeps import advance_millisecond as f;"
        "print(run_digest(7), sum(f.stats.cache_misses.values()))"
    )
    root = Path(__file__).parents[2]
    run = subprocess.run([sys.executable, "-c", script], cwd=root, capture_output=True, text=True)
    assert run.stdout.split() == [digest, "0"], run.stderr  # nothing was compiled: the code came from the cache


def test_every_seed_is_another_plant_and_the_nominal_plant_has_no_scatter() -> None:
    one, other = (Plant(SCENE, PARAMETERS, "rice_box", 0.0, seed) for seed in (1, 2))
    assert not np.array_equal(one.model.body_mass, other.model.body_mass)
    for name in ("B", "B_theta", "K", "D", "friction_p1", "gravity_factor"):
        assert not np.array_equal(one.joints[name], other.joints[name])
        assert not np.array_equal(one.joints[name][0], one.joints[name][1])
    nominal = Plant.nominal(SCENE, PARAMETERS, "rice_box")
    assert np.array_equal(nominal.joints["K"], [PARAMETERS.joints.K] * 2)
    assert np.array_equal(nominal.joints["gravity_factor"], np.ones((2, 7)))


def test_idle_arms_hold_their_pose() -> None:
    cell = nominal_cell("rice_box")
    start = cell.plant.data.qpos[:14].copy()
    for _ in range(1000):
        cell.left.read()
    assert np.abs(cell.plant.data.qpos[:14] - start).max() < 1e-6


@pytest.mark.parametrize("angle", [np.nan, np.inf, 30.0])
def test_a_simulation_that_diverges_says_so_and_does_not_start_again(angle: float) -> None:
    plant = Plant.nominal(SCENE, PARAMETERS, "rice_box")
    plant.advance()
    plant.motors[0]["theta"][3] = angle
    with pytest.raises(SimulationDiverged, match="diverged 2 ms after its start"):
        plant.advance()
