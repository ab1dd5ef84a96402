"""Other models of robots in the simulated cell: each arm is stopped at the limits of its own model."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.errors import CommandRejected
from hal.robot_errors import error_names
from hal.robots import FER, FR3, RobotModel, robot
from sim_robot import reflexes
from sim_robot.arm_description import arm_description
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.lab_objects import with_lab_objects
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.robot_files import DQ_MAX, MIRROR, with_key, write_robot
from tests.support.robot_files import HOME as SHORT_HOME

HOME = np.array(load_scene().left.home)


def cell_file(folder: Path, left: str = "fer", right: str = "fer") -> Path:
    """Write what the simulated robot reads of a cell's file."""
    path = folder / "lab.toml"
    text = ""
    for side, model, mirror in (("left", left, (1,) * 7), ("right", right, MIRROR)):
        home = f"home = {[a * b for a, b in zip(SHORT_HOME, mirror, strict=True)]}\n" if model == "shorty.toml" else ""
        text += f'[{side}]\nmodel = "{model}"\n{home}'
    path.write_text(text)
    return path


def judged(models: tuple[RobotModel, RobotModel], joint: int, q: float, dq: float) -> list[tuple[str, ...]]:
    """Return the errors of both arms where this joint (1 to 7) is at q and dq, the others at home and at rest."""
    cell = simulated_cell("none", 0.0, 0)
    states, masks = cell.states.copy(), np.zeros(2, np.int64)
    states["q"], states["dq"], states["tau_J"] = HOME, 0.0, 0.0
    states["q"][:, joint - 1], states["dq"][:, joint - 1] = q, dq
    parameters, judged = load_plant_parameters().reflexes, np.zeros(2, reflexes.JUDGED_RECORD)
    reflexes.judge_of_states(states, cell.sensors.kinematics, judged, models, parameters, masks)()
    return [error_names(int(mask)) for mask in masks]


@pytest.mark.parametrize(
    ("joint", "q", "dq", "stopped", "name"),
    [
        (1, 0.0, 2.3, FER, "joint_velocity_violation"),  # 2.175 rad/s; the FR3: 2.62
        (5, -1.6, 3.0, FER, "joint_velocity_violation"),
        (7, 2.95, 0.0, FER, "joint_position_limits_violation"),  # 2.8973 rad; the FR3: 3.0196
        (6, 4.0, 0.0, FER, "joint_position_limits_violation"),
        (1, 2.85, 0.0, FR3, "joint_position_limits_violation"),  # 2.7501 rad; the FER: 2.8973
        (6, 0.3, 0.0, FR3, "joint_position_limits_violation"),
        (2, 1.74, 1.5, FR3, "joint_velocity_violation"),  # near its end the FR3 has to be slower, the FER has not
    ],
)
def test_an_arm_is_stopped_at_its_model_s_limits_and_the_other_one_is_not(
    joint: int, q: float, dq: float, stopped: RobotModel, name: str
) -> None:
    other = FR3 if stopped is FER else FER
    assert judged((stopped, other), joint, q, dq) == [(name,), ()]
    assert judged((other, stopped), joint, q, dq) == [(), (name,)]


def test_the_speed_of_the_end_effector_is_judged_by_the_model(tmp_path: Path) -> None:
    path = write_robot(tmp_path)
    path.write_text(with_key(path.read_text(), "translation", "[0.05, 9.0, 4500.0]"))
    slow = robot(str(path))
    assert judged((slow, FR3), 1, 0.0, 0.5) == [("cartesian_velocity_violation",), ()]


def test_a_cell_file_names_the_models(tmp_path: Path) -> None:
    cell = simulated_cell("rice_box", 0.0, 3, cell_file=cell_file(tmp_path, "fer", "fr3"))
    assert cell.plant.robots == (FER, FR3)
    cell.next_state()
    assert cell.boxes[0].errors == cell.boxes[1].errors == 0


def turned(cell: SimulatedCell, side: int, joint: int, tau: float, ticks: int) -> tuple[float, tuple[str, ...]]:
    """Push one joint of an arm until its robot stops it; return its largest velocity and the errors."""
    arm, fastest = (cell.left, cell.right)[side], 0.0
    with suppress(CommandRejected):
        for tick in range(ticks):
            command = np.zeros(7)
            command[joint - 1] = np.sign(tau) * min(abs(tau), 0.5 * tick)
            for other in (cell.left, cell.right):
                state = other.read()
                other.write(command if other is arm else np.zeros(7))
                if other is arm:
                    fastest = max(fastest, abs(float(state.dq[joint - 1])))
    return fastest, error_names(cell.boxes[side].errors)


def test_a_simulated_panda_stops_itself_at_its_own_velocity(tmp_path: Path) -> None:
    cell = simulated_cell("none", 0.0, 3, cell_file=cell_file(tmp_path))
    fastest, names = turned(cell, 0, 1, -20.0, 2000)
    assert names == ("joint_velocity_violation",)
    assert fastest == pytest.approx(FER.limits.dq_max[0], abs=0.1)


def test_a_made_up_robot_is_simulated_from_two_files_in_a_folder(tmp_path: Path) -> None:
    write_robot(tmp_path)
    cell = simulated_cell("none", 0.0, 3, cell_file=cell_file(tmp_path, "shorty.toml", "shorty.toml"))
    model = cell.plant.robots[0]
    assert model.title == "Shorty"
    reach = np.linalg.norm(arm_description(model).T_parent_joint[:, :3, 3], axis=1).sum()
    assert reach < np.linalg.norm(arm_description(FR3).T_parent_joint[:, :3, 3], axis=1).sum() - 0.03
    fastest, names = turned(cell, 0, 1, -20.0, 2000)
    assert names == ("joint_velocity_violation",)
    assert fastest == pytest.approx(DQ_MAX[0], abs=0.1)


def test_the_plant_takes_its_own_numbers_from_the_model_s_file(tmp_path: Path) -> None:
    path = write_robot(tmp_path)
    path.write_text(path.read_text() + "\n[plant]\nK = [5e3, 5e3, 5e3, 5e3, 4e3, 4e3, 4e3]\n")
    scene = with_lab_objects(load_scene(), cell_file(tmp_path, "shorty.toml", "fr3"))
    parameters = load_plant_parameters()
    assert parameters.of(scene.left.robot).joints.K == (5e3, 5e3, 5e3, 5e3, 4e3, 4e3, 4e3)
    assert parameters.of(scene.left.robot).joints.D == parameters.joints.D
    assert parameters.of(scene.right.robot) is parameters


@pytest.mark.parametrize(
    ("left", "complaint"),
    [
        ("ur5", r"left: unknown robot model 'ur5': choose one of fer, fr3, or the path of a TOML"),
        ("none.toml", r"left: .*none\.toml: cannot be read: No such file or directory"),
        ("shorty.toml", r"shorty\.toml:\d+: key plant\.stiffness.*, found 'stiffness'"),
    ],
)
def test_a_model_that_cannot_be_used_is_one_line(tmp_path: Path, left: str, complaint: str) -> None:
    path = write_robot(tmp_path)
    path.write_text(path.read_text() + "\n[plant]\nstiffness = 3\n")
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        simulated_cell("none", 0.0, 0, cell_file=cell_file(tmp_path, left))
    assert "\n" not in str(caught.value)
