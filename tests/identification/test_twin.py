"""A twin: what is found of an arm is what it is, with intervals that contain it; what is not seen is not told."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError, read_toml, toml_text
from hal.cycle import CYCLE
from rtstack.cells import load_description
from rtstack.identification import arm as identification
from rtstack.identification import sweep
from rtstack.identification.arm import Joint
from rtstack.identification.estimate import linear
from rtstack.identification.procedure import uncompensated
from rtstack.identification.twin import LINK_SHARES, link_lateness
from rtstack.model.arm_model import ArmModel
from rtstack.trials.assembly import arm_controllers
from rtstack.trials.move import run_motion
from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.profile import LATE_SHARES, Twin, load_profile
from sim_robot.scene import load_scene

IDEAL_FILE = Path(str(files("sim_robot"))) / "parameters/profiles/ideal.toml"
OWN = Twin(
    B_theta=(0.3, 0.15, 0.2, 0.1, 0.09, 0.05, 0.08), friction_p1=(0.9, 0.5, 1.1, 0.8, 0.5, 0.5, 0.3),
    payload_kg=0.8, payload_centre=(0.02, -0.01, 0.15),
)  # fmt: skip


def plant_of(twin: Twin) -> Plant:
    profile = replace(load_profile(), left=twin)
    return Plant(load_scene(), load_plant_parameters(), "rice_box", 0.0, 5, profile=profile)


def excited(twin: Twin, run: int):
    """Run the motion of all joints on an arm; return the samples of the left arm."""
    description, _ = load_description(None)
    plant, parameters = plant_of(twin), uncompensated(description)
    cell = SimulatedCell(plant, load_scene(), load_plant_parameters(), run)
    arms = arm_controllers(description, parameters)
    reason, columns = run_motion(
        sweep.all_joints(description, arms, run), description, parameters, cell.as_cell("direct")
    )
    assert reason is None
    return identification.arm_samples(ArmModel(description.left, description.pad).pin_model, [columns.arm[0]])


@pytest.mark.long
def test_an_arm_and_its_payload_are_found_in_the_motion_of_all_joints(monkeypatch):
    monkeypatch.setattr(sweep, "TONES_S", 8.0)  # 18 s otherwise
    bare, loaded = excited(replace(OWN, payload_kg=0.0), 0), excited(OWN, 1)
    link = identification.links(loaded, bare)
    load = link.payload
    assert load.value[0] == pytest.approx(OWN.payload_kg, rel=0.05)
    assert load.value[1:] / load.value[0] == pytest.approx(OWN.payload_centre, abs=0.02)
    truth = plant_of(OWN).joints[0]
    inside = []
    for j in range(7):
        found = identification.joint(link, j, (0.7, 8.0, 0.02), 0.15)
        for k, name in enumerate(Joint.MOTOR[:4]):
            inside.append(abs(found.motor.value[k] - truth[name][j]) <= found.motor.half_width[k])
        assert found.motor.value[0] == pytest.approx(truth["friction_p1"][j], rel=0.05)
        assert found.motor.value[3] == pytest.approx(truth["B_theta"][j], rel=0.05)
        if j < 6:
            assert found.spring.value[0] == pytest.approx(truth["K"][j], rel=0.1)
    assert np.mean(inside) > 0.7  # of 28 intervals of 95 %


def test_intervals_hold_where_neighbouring_samples_share_their_errors():
    generator = np.random.default_rng(1)
    inside = 0
    blocks = np.repeat(np.arange(100), 20)
    for _ in range(200):
        X = np.column_stack([np.repeat(generator.normal(size=100), 20), np.ones(2000)])
        y = X @ [2.0, 1.0] + np.repeat(generator.normal(size=100), 20)
        found = linear(X, y, blocks)
        inside += abs(found.value[0] - 2.0) <= found.half_width[0]
    assert 0.90 <= inside / 200 <= 0.99


@pytest.mark.long
def test_a_log_that_does_not_excite_says_so_and_its_profile_can_be_simulated(demonstration, tmp_path, command_line):
    out = tmp_path / "twin"
    said = command_line("twin", demonstration.path, "--out", out)
    assert said.returncode == 0, said.stderr
    assert "not identified: payload_kg" in said.stdout
    assert "rtstack excite" in said.stdout
    found = json.loads((out / "twin.json").read_text())["left"]["parameters"]
    unknown = {each["name"] for each in found if not each["identified"]}
    assert {"payload_kg", "D"} <= unknown
    profile = load_profile(str(out / "profile.toml"))
    assert profile.left.D is None
    assert profile.left.payload_kg == 0.0
    again = command_line("twin", demonstration.path, "--out", out)
    assert again.returncode == 2
    assert "choose another name" in again.stderr
    options = ("--profile", out / "profile.toml", "--cell-file", out / "cell.toml")
    played = command_line("teach", tmp_path / "again.mcap", *options)
    assert played.returncode == 0, played.stderr


@pytest.mark.long
def test_what_touches_tells_the_estimates_delay_and_the_pads_stiffness(demonstration, tmp_path, command_line):
    truth = {
        "torque_offset": [0.3, -0.2, 0.1, 0.0, 0.05, -0.1, 0.02],
        "estimate_delay_ms": 4,
        "contact_stiffness": 28e3,
    }
    base, _ = read_toml(IDEAL_FILE)
    (tmp_path / "own.toml").write_text(toml_text(base | {"left": truth, "right": truth}))
    log, out = tmp_path / "own.mcap", tmp_path / "twin"
    assert command_line("teach", log, "--profile", tmp_path / "own.toml").returncode == 0
    said = command_line("twin", log, "--held-out", demonstration.path, "--out", out)
    assert said.returncode == 0, said.stderr
    assert f"held out: {demonstration.path}" in said.stdout
    assert "cannot be identified from these logs: the link" in said.stdout
    found = load_profile(str(out / "profile.toml"))
    for arm in (found.left, found.right):
        assert arm.estimate_delay_ms == truth["estimate_delay_ms"]
        assert arm.contact_stiffness == pytest.approx(truth["contact_stiffness"], rel=0.1)
        assert arm.torque_offset == pytest.approx(truth["torque_offset"], abs=0.02)
        assert arm.link_late_us is None
    numbers = json.loads((out / "twin.json").read_text())
    assert numbers["held_out"] == [str(demonstration.path)]
    assert numbers["replays"][0]["log"] == str(demonstration.path)
    twice = command_line("twin", log, "--held-out", log, "--out", tmp_path / "other")
    assert twice.returncode == 2
    assert "is to be held out, and to be fitted" in twice.stderr


def test_how_late_a_links_states_are_is_told_with_intervals_that_hold():
    generator, inside = np.random.default_rng(3), []
    late_us = np.array([40.0, 90.0, 300.0, 1500.0])
    for _ in range(10):
        cycles = np.zeros(20_000, CYCLE)
        cycles["t_ns"], cycles["unread"] = np.arange(len(cycles)) * 1_000_000, 1
        drawn = np.interp(generator.random(len(cycles)), (0.0, *LATE_SHARES), (0.0, *late_us))
        cycles["arrived_us"] = 7e6 + 1e-3 * cycles["t_ns"] + drawn
        found = link_lateness([cycles])
        inside.append(np.abs(found.value - late_us) <= found.half_width)
    assert np.mean(inside) > 0.8
    assert np.isinf(link_lateness([cycles[:5000]]).half_width).all()
    assert LINK_SHARES == LATE_SHARES


def test_what_cannot_be_used_is_one_line(tmp_path, command_line):
    missing = command_line("twin", tmp_path / "none.mcap", "--out", tmp_path / "twin")
    assert missing.returncode == 2
    assert "none.mcap" in missing.stderr
    with pytest.raises(ConfigurationError, match=r"or the path of a \.toml"):
        load_profile("mine")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_profile(str(tmp_path / "mine.toml"))


def test_the_profile_of_an_arm_is_the_arm_that_is_simulated():
    drawn, own = plant_of(Twin()), plant_of(OWN)
    assert own.joints[0]["B_theta"].tolist() == list(OWN.B_theta)
    assert np.array_equal(own.joints[0]["K"], drawn.joints[0]["K"])
    assert np.array_equal(own.joints[1]["B_theta"], drawn.joints[1]["B_theta"])
    # joint 2 carries the payload with a lever of some tenths of a metre
    assert abs(own.motors[0]["tau_J"][1] - drawn.motors[0]["tau_J"][1]) > 2.0
    assert own.joints[0]["friction_offset"][0] == pytest.approx(
        OWN.friction_p1[0] / (1.0 + np.exp(-own.joints[0]["friction_p2"][0] * own.joints[0]["friction_p3"][0]))
    )
