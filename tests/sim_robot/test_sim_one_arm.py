"""A cell with one arm: it is simulated like an arm of two, and nothing of the other one is there."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.errors import CommandRejected, ConnectionLost, NoGripper, ObjectOutOfReach
from sim_robot.cell import SimulatedCell, cell_scene, simulated_cell
from sim_robot.faults.file import faults_in, load_faults
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.server import Server
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.profile import load_profile
from sim_robot.scene import SIDES, load_scene
from tests.support.built_cell import profile
from tests.support.fci.server import addresses
from tests.support.plant_object import object_pose

SCENES = Path(__file__).parents[2] / "sim_robot" / "scenes"
PARAMETERS = load_plant_parameters()
SCENE = load_scene()
REST = np.zeros(7)
one_side = pytest.mark.parametrize("side", SIDES)


def without(name: str, side: str, folder: Path) -> Path:
    """Return a copy of a scene's file without the table of one arm."""
    text = (SCENES / f"{name}.toml").read_text(encoding="utf-8")
    path = folder / f"{name}.toml"
    path.write_text(re.sub(rf"^\[{side}\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.MULTILINE), encoding="utf-8")
    return path


def contacts(plant: Plant) -> set[str]:
    """Return the names of all geoms that touch another one."""
    return {plant.model.geom(geom).name for geom in np.ravel(plant.data.contact.geom)}


@one_side
def test_a_file_with_one_arm_is_the_scene_without_the_other(side: str, tmp_path: Path) -> None:
    other = SIDES[1 - SIDES.index(side)]
    scene = load_scene(without("grab", other, tmp_path))
    assert scene == SCENE.only((side,))
    assert (scene.sides, scene.arms, getattr(scene, other)) == ((side,), (getattr(SCENE, side),), None)
    assert scene.pads == (SCENE.pad,)
    assert SCENE.only(SIDES) == SCENE


def test_a_scene_without_an_arm_or_with_one_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = without("grab", "left", tmp_path)
    with pytest.raises(ConfigurationError, match="the cell has no left arm, only right"):
        simulated_cell("rice_box", 0.0, 0, scene=path, sides=SIDES)
    path.write_text(re.sub(r"^\[right\]\n(?:[^\[\n].*\n|\n)*", "", path.read_text(), flags=re.MULTILINE))
    with pytest.raises(ConfigurationError, match=r"there is no arm: add \[left\], \[right\] or both"):
        load_scene(path)


@one_side
def test_one_arm_holds_and_moves_under_torque(side: str) -> None:
    cell = simulated_cell("rice_box", 0.0, 3, sides=(side,))
    (arm,) = cell.arms
    assert (cell.left, cell.right) == ((arm, None) if side == "left" else (None, arm))
    assert (cell.states.shape, cell.plant.joints.shape, cell.plant.data.qpos.shape) == ((1,), (1,), (14,))
    names = [cell.plant.model.body(k).name for k in range(cell.plant.model.nbody)]
    assert not any(name.startswith(SIDES[1 - SIDES.index(side)]) for name in names)
    q_start = np.array(arm.read().q)
    for _ in range(200):
        arm.read()
    assert np.abs(arm.read().q - q_start).max() < 1e-3
    for ms in range(200):
        arm.read()
        arm.write(np.eye(7)[1] * 2.0 * min(1.0, ms / 100.0))
    moved = arm.read().q - q_start
    assert moved[1] > 0.01
    as_hal_has_it = cell.as_cell("direct")
    assert (as_hal_has_it.left, as_hal_has_it.right) == (cell.left, cell.right)


@one_side
def test_an_arm_alone_moves_as_it_does_beside_another_one(side: str) -> None:
    alone, pair = (Plant.nominal(scene, PARAMETERS, "rice_box") for scene in (SCENE.only((side,)), SCENE))
    k, home = SIDES.index(side), np.array(getattr(SCENE, side).home)
    for ms in range(200):
        goal = home + 0.2 * np.sin(5e-3 * ms) * np.array([0.0, -1.0, 0.5, 0.3, 0.0, 0.5, 0.2])
        alone.track(0, goal, REST)
        pair.track(k, goal, REST)
        alone.advance()
        pair.advance()
    np.testing.assert_allclose(alone.data.qpos[:7], pair.data.qpos[7 * k : 7 * k + 7], atol=1e-9)
    np.testing.assert_allclose(alone.motors["tau_J"][0], pair.motors["tau_J"][k], atol=1e-6)
    assert np.abs(alone.data.qpos[:7] - home).max() > 0.1


def _turned(plant: Plant, home: Sequence[float], begin: float, end: float) -> None:
    """Turn joint 1 of the only arm from one angle to another, rad from home, in 0.6 s."""
    for ms in range(600):
        plant.track(0, np.array(home) + np.eye(7)[0] * (begin + (end - begin) * ms / 600), REST)
        plant.advance()


@one_side
def test_one_arm_pushes_the_object(side: str) -> None:
    outwards = 1.0 if side == "left" else -1.0
    scene = SCENE.only((side,))
    plant = Plant.nominal(scene, PARAMETERS, "rice_box", 0.185 * outwards)
    start = object_pose(plant)[0]
    _turned(plant, scene.arms[0].home, 0.0, -0.15 * outwards)
    assert f"{side}_pad" in contacts(plant)
    assert outwards * (object_pose(plant)[0] - start)[1] < -0.02
    assert np.abs(plant.motors["tau_ext"]).max() > 0.5
    assert not plant.put_object_back()  # the pad stands in its place, and touches it
    assert not plant.away


@one_side
def test_an_object_in_whose_place_a_pad_stands_is_off_the_table_meanwhile(side: str) -> None:
    outwards = 1.0 if side == "left" else -1.0
    scene = SCENE.only((side,))
    plant = Plant.nominal(scene, PARAMETERS, "rice_box", 0.185 * outwards)
    start = object_pose(plant)[0]
    plant.data.qpos[plant.first_of_object + 1] -= 0.35 * outwards  # where a push has left it
    _turned(plant, scene.arms[0].home, 0.0, -0.15 * outwards)
    assert not plant.put_object_back()
    _turned(plant, scene.arms[0].home, -0.15 * outwards, 0.0)
    assert object_pose(plant)[0][0] > 5.0
    assert plant.put_object_back()
    plant.advance()
    assert object_pose(plant)[0] == pytest.approx(start, abs=1e-3)


@one_side
def test_beside_a_missing_arm_the_edge_of_the_table_is_the_limit(side: str) -> None:
    upper, lower = (190, -250) if side == "left" else (250, -190)
    for mm in (upper + 1, lower - 1):
        with pytest.raises(ObjectOutOfReach, match=re.escape(f"{lower:+d} to {upper:+d} mm (table edge and pad)")):
            simulated_cell("rice_box", 1e-3 * mm, 0, sides=(side,))
    for mm in (upper - 1, lower + 1):
        simulated_cell("rice_box", 1e-3 * mm, 0, sides=(side,))
    empty = simulated_cell("none", 0.0, 0, sides=(side,))
    for _ in range(20):
        empty.arms[0].read()
    assert object_pose(empty.plant)[0][0] > 5.0
    assert not empty.tracker.latest().record["seen"][0]


def test_one_arm_hits_the_platform(tmp_path: Path) -> None:
    scene = load_scene(without("platform", "right", tmp_path))
    assert scene.platform is not None
    scene = replace(scene, platform=replace(scene.platform, centre=(0.35, 0.0, 0.54)))  # just below the pad
    plant = Plant.nominal(scene, PARAMETERS, "nothing")
    for ms in range(300):
        plant.track(0, np.array(scene.arms[0].home) + np.eye(7)[1] * 0.1 * ms / 300, REST)
        plant.advance()
    assert {"left_pad", "platform"} <= contacts(plant)
    assert np.abs(plant.motors["tau_ext"]).max() > 1.0


def test_errors_name_the_arm_that_there_is() -> None:
    cell = simulated_cell("rice_box", 0.0, 0, sides=("right",))
    with pytest.raises(NoGripper, match=re.escape("the right arm has no hand: load a scene with [right.hand]")):
        cell.gripper(0)
    (arm,) = cell.arms
    arm.read()
    arm.write(np.full(7, 50.0))
    with pytest.raises(CommandRejected, match="right arm in reflex: controller_torque_discontinuity"):
        arm.read()
    arm.recover()
    arm.close()
    with pytest.raises(ConnectionLost, match="the right arm was closed"):
        arm.read()


def fault(arm: str) -> dict:
    return {"kind": "push", "arm": arm, "at_s": 0.0, "force_N": [0.0, 0.0, 20.0]}


def test_a_fault_of_the_one_arm_acts_on_it_and_others_are_refused(tmp_path: Path) -> None:
    script = faults_in({"fault": [fault("right"), {"kind": "object_tilted", "tilt_deg": 2.0}]}, "x", sides=("right",))
    pushed, free = (simulated_cell("rice_box", 0.0, 0, sides=("right",), faults=f) for f in (script, script[1:]))
    for cell in (pushed, free):
        for _ in range(50):
            cell.arms[0].read()
            cell.arms[0].write(REST)
    assert pushed.arms[0].read().O_T_EE[2, 3] > free.arms[0].read().O_T_EE[2, 3] + 1e-3
    path = tmp_path / "script.toml"
    for arm in ("left", "both"):
        path.write_text(f'[[fault]]\nkind = "user_stop"\nat_s = 1.0\narm = "{arm}"\n', encoding="utf-8")
        with pytest.raises(ConfigurationError) as refused:
            load_faults(path, ("right",))
        assert str(refused.value) == f"{path}:4: fault 1 (user_stop): arm cannot be '{arm}'; say right, the one arm"


def test_a_profile_may_have_both_arms_but_cannot_exchange_them(tmp_path: Path) -> None:
    twins = tmp_path / "twins.toml"
    ideal = profile(tmp_path / "ideal.toml", {"left_mm": [0.0, 0.0, 50.0], "right_mm": [10.0, 0.0, 0.0]})
    twins.write_text(ideal.read_text() + "\n[left]\npayload_kg = 0.5\n[right]\ncontact_stiffness = 2e4\n")
    plant = simulated_cell("rice_box", 0.0, 0, sides=("right",), profile=str(twins)).plant
    assert load_profile(str(twins)).twins(plant.sides)[0].contact_stiffness == 2e4
    assert plant.data.body("right_link0").xpos == pytest.approx((-0.39, -0.5, 0.0))
    swapped = profile(tmp_path / "swapped.toml", {"swapped": True})
    with pytest.raises(ConfigurationError, match="exchanges two arms, and this cell has one"):
        simulated_cell("rice_box", 0.0, 0, sides=("right",), profile=str(swapped))


def test_a_labs_file_with_one_arm_is_a_cell_with_this_arm(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text('[right]\nmodel = "fr3"\n\n[objects.crate]\nmass = 0.8\nsize = [0.16, 0.3, 0.22]\n')
    assert cell_scene(None, file).sides == ("right",)
    assert isinstance(simulated_cell("crate", 0.0, 0, cell_file=file), SimulatedCell)
    with pytest.raises(ConfigurationError, match="the cell has no left arm, only right"):
        cell_scene(None, file, ("left",))


def test_a_hand_is_there_with_its_arm_alone() -> None:
    scene = SCENES / "hand.toml"
    with_hand, without_hand = (simulated_cell("block", 0.0, 0, scene=scene, sides=(side,)) for side in SIDES)
    assert with_hand.gripper(0).homing()
    assert without_hand.hands == (None,)


def test_one_arm_near_the_table_is_seen() -> None:
    scene = SCENE.only(("right",))
    scene = replace(scene, pad=replace(scene.pad, size=(0.02, 0.02, 0.03)))  # the wrist is lower than the pad
    plant = Plant.nominal(scene, PARAMETERS, "rice_box", 0.1)
    server = Server(SimulatedCell(plant, scene, PARAMETERS, 0, box_kind=DrivenBox), PARAMETERS, addresses()[:1])
    try:
        for ms in range(1000):
            plant.track(0, np.array(scene.arms[0].home) + np.eye(7)[1] * 0.4 * ms / 1000, REST)
            server.advance()
            if server._proximity.masks[0]:
                break
        assert server._proximity.masks.shape == (1,)
        assert server._proximity.masks[0]
    finally:
        server.close()
