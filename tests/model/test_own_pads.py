"""Each arm's own pad, with its full transform: one place for plant, judge, controller, plans and the robot."""

import contextlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.displacement import Displacement
from rtstack.cells import default_cell_file
from rtstack.cells.kinds import open_cell
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription, base_frame, load_cell_description
from rtstack.references.demonstration import end_effector_pose
from rtstack.safety.body import arm_body
from rtstack.safety.geometry import place_arm
from rtstack.safety.limits import HARDWARE
from rtstack.safety.records import StopProfile, empty_memory, rules
from rtstack.trials.review import review_log
from sim_robot.cell import simulated_cell

# the pads' faces are at home where those of the grabbing cell are
LEFT = """
[left.pad]  # on an angled bracket whose mass is not in the pad's middle
size = [0.1, 0.1, 0.03]
mass = 0.5
flange_to_face = 0.06
offset_xy = [0.04, 0.0]
orientation_wxyz = [0.976296, -0.2164396, 0.0, 0.0]  # -25 deg about the flange's x
centre = [0.015, 0.005, 0.03]
inertia = [1.2e-3, 1.1e-3, 9e-4, 5e-5, 0.0, 0.0]
"""
RIGHT = """
[right.pad]  # on an arm of 50 mm, turned by 45 deg
size = [0.1, 0.1, 0.03]
mass = 0.42
flange_to_face = 0.05
offset_xy = [0.0, 0.05]
orientation_wxyz = [0.9238795, 0.0, 0.0, 0.3826834]
"""
HOMES = {
    "left": "[-0.301958, -0.20658, 0.207857, -2.730622, -1.356569, 2.012818, 0.889423]",
    "right": "[0.301958, -0.110165, -0.321633, -2.700155, 1.537481, 1.591224, -1.809548]",
}


def cell_with_own_pads(folder: Path) -> Path:
    """Write the cell's file; return its path."""
    lines, side = default_cell_file().read_text(encoding="utf-8").splitlines(), ""
    for k, line in enumerate(lines):
        side = line.strip("[]") if line in ("[left]", "[right]") else side
        if line.startswith("home = "):
            lines[k] = f"home = {HOMES[side]}"
    path = folder / "lab.toml"
    path.write_text("\n".join(lines) + "\n" + LEFT + RIGHT, encoding="utf-8")
    return path


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    return cell_with_own_pads(tmp_path)


@pytest.mark.long
def test_a_demonstration_and_a_trial_succeed(
    cell_file: Path, tmp_path: Path, command_line: Callable[..., CompletedProcess[str]]
) -> None:
    reference, path = tmp_path / "ref.mcap", tmp_path / "trial.mcap"
    for command in (
        ("teach", reference, "--cell-file", cell_file),
        ("trial", "--reference", reference, "--cell-file", cell_file, "--displacement-mm=-20", "--log", path),
    ):
        ran = command_line(*command)
        assert ran.returncode == 0, ran.stderr + ran.stdout
    review = review_log(path)
    assert review.score is not None
    assert review.score.held
    assert json.loads(review.recorded["safety_interventions"]) == 0


def test_plant_robot_controller_and_judge_have_the_face_in_the_same_place(cell_file: Path) -> None:
    description, cell = load_cell_description(cell_file), simulated_cell("none", 0.0, 0, cell_file=cell_file)
    states = [cell.left.read(), cell.right.read()]
    judged = [arm_body(arm.base, tool) for arm, tool in zip(mountings(description), description.tools, strict=True)]
    for side, mounting in enumerate(mountings(description)):
        body = cell.plant.pad_bodies[side]
        turn = cell.plant.data.xmat[body].reshape(3, 3)
        face = cell.plant.data.xpos[body] + turn @ cell.plant.face_in_pad[side]
        place, rotation = end_effector_pose(ArmModel(mounting, description.pad), states[side].q)
        np.testing.assert_allclose(place, face, atol=1e-4)
        np.testing.assert_allclose(rotation, turn, atol=1e-3)
        frame = base_frame(mounting)
        said = states[side].O_T_EE
        np.testing.assert_allclose(frame.rotation @ said[:3, 3] + frame.translation, place, atol=1e-5)
        np.testing.assert_allclose(frame.rotation @ said[:3, :3], rotation, atol=1e-5)
        rule, memory = rules(HARDWARE, StopProfile(), judged[side], judged[1 - side])[0], empty_memory(1)[0]
        place_arm(states[side].q, np.zeros(7), rule, memory)
        np.testing.assert_allclose(memory["face_world"], place, atol=1e-6)
        last = int(judged[side]["first"][-1]) - 1
        middle = memory["ends_world"][last].mean(axis=0)
        np.testing.assert_allclose(middle, cell.plant.data.xpos[body], atol=1e-4)
    np.testing.assert_allclose([states[0].O_T_EE[1, 2], states[1].O_T_EE[1, 2]], [-1.0, 1.0], atol=1e-3)


def mountings(description: CellDescription) -> tuple:
    return description.left, description.right


@pytest.mark.parametrize("side", [0, 1])
def test_a_force_on_a_pad_is_right_in_the_world(cell_file: Path, side: int) -> None:
    description, worst = load_cell_description(cell_file), 0.0
    frame = base_frame(mountings(description)[side])
    for force in 20.0 * np.vstack([np.eye(3), -np.eye(3), np.ones((1, 3)) / np.sqrt(3.0)]):
        cell = simulated_cell("none", 0.0, 2, cell_file=cell_file)
        cell.plant.push(side, force)
        felt = np.array([(cell.left, cell.right)[side].read().O_F_ext_hat_K.copy() for _ in range(300)])[150:]
        wrench = felt.mean(axis=0)
        worst = max(worst, float(np.linalg.norm(frame.rotation @ wrench[:3] + force)) / 20.0)
        assert np.linalg.norm(wrench[3:]) < 0.05 * 20.0 * 0.1
    print(f"the push on the {('left', 'right')[side]} pad is felt within {100.0 * worst:.2f} %")  # docs/howto/cell.md
    assert worst < 0.05


def test_the_weight_of_a_bracket_is_known_to_the_controller(cell_file: Path) -> None:
    description, cell = load_cell_description(cell_file), simulated_cell("none", 0.0, 0, cell_file=cell_file)
    for arm, mounting in zip((cell.left, cell.right), mountings(description), strict=True):
        tau_J = np.mean([arm.read().tau_J for _ in range(200)], axis=0)
        model = ArmModel(mounting, description.pad)
        without = ArmModel(replace(mounting, pad=replace(mounting.pad, mass=0.0, inertia=None)), description.pad)
        for each in (model, without):
            each.update(arm.read().q, np.zeros(7))
        assert np.abs(tau_J - model.g).max() < 0.15 * np.abs(tau_J - without.g).max()


def test_a_robot_on_the_wire_is_told_each_arm_s_own(cell_file: Path) -> None:
    description = load_cell_description(cell_file)
    with contextlib.closing(open_cell("lockstep", "", Displacement(), 0, description, cell_file=cell_file)) as cell:
        for arm, mounting in zip((cell.left, cell.right), mountings(description), strict=True):
            state = arm.read()
            place, rotation = end_effector_pose(ArmModel(mounting, description.pad), state.q)
            frame = base_frame(mounting)
            np.testing.assert_allclose(frame.rotation @ state.O_T_EE[:3, 3] + frame.translation, place, atol=1e-5)
            np.testing.assert_allclose(frame.rotation @ state.O_T_EE[:3, :3], rotation, atol=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("offset_xy = [0.04, 0.0]", "offset_xy = [0.04]", r"lab\.toml:\d+: key left\.pad\.offset_xy"),
        ("[0.976296, -0.2", "[0.5, -0.2", r"lab\.toml:\d+: key left\.pad\.orientation_wxyz: a unit quaternion"),
        ("[1.2e-3, 1.1e-3, 9e-4", "[5e-3, 1.1e-3, 9e-4", r"lab\.toml:\d+: key left\.pad\.inertia: no body has"),
        ("mass = 0.42", "mass = -0.42", r"lab\.toml:\d+: key right\.pad\.mass"),
        ("centre = ", "center = ", r"lab\.toml:\d+: key left\.pad\.center"),
        ("size = [0.1, 0.1, 0.03]\nmass = 0.42", "size = [0.1, 0.0, 0.03]\nmass = 0.42", r"key right\.pad\.size"),
    ],
)
def test_what_is_no_pad_is_one_line_with_its_key(cell_file: Path, old: str, new: str, complaint: str) -> None:
    text = cell_file.read_text(encoding="utf-8")
    assert old in text
    cell_file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=complaint):
        load_cell_description(cell_file)
