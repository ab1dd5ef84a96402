"""franka-rs as its examples use it: the state, the model, targets for its own torques and for the robot's controllers.

`python franka_rs_program.py ADDRESS [PART...]` prints a line for each part that went well; without parts, all. Its loop
runs on a thread in Rust; what is asked of it is asked by the clock of the wall.
"""

import itertools
import sys
import time
from typing import Any

import franka
import numpy as np
from settling import settles  # beside this file

STEP_M, STEP_RAD = 0.03, 0.1


def state(robot: franka.Robot) -> None:
    """What an idle robot says of itself, and what the client's model makes of the same joints."""
    states = [robot.read_once() for _ in range(20)]
    assert all(before.time < after.time for before, after in itertools.pairwise(states))
    last, model = states[-1], robot.model()
    assert robot.fci_version == 10
    assert last.robot_mode == "idle"
    assert not last.current_errors
    assert last.flat().shape == (franka.FLAT_LEN,)
    assert np.abs(model.pose("ee", last.q, last.F_T_EE) - last.O_T_EE).max() < 1e-4
    gravity = model.gravity(last.q, last.m_total, last.F_x_Ctotal)
    assert np.abs(last.tau_J - gravity).max() < 2.0  # friction, and the noise of the sensors


def cartesian(robot: franka.Robot, **options: Any) -> None:
    """There and back, by a target and by a chunk of them."""
    start = robot.read_once().O_T_EE[:3, 3]
    with robot.cartesian_targets(max_velocity=0.3, max_acceleration=1.0, max_jerk=20.0, **options) as arm:

        def away(goal: np.ndarray) -> float:
            return float(np.linalg.norm(arm.state().O_T_EE[:3, 3] - goal))

        arm.move_by([0.0, 0.0, STEP_M])
        above = start + [0.0, 0.0, STEP_M]
        assert settles(lambda: away(above), 0.01)
        arm.follow(np.linspace(above, start, 20), dt=0.02)
        assert settles(lambda: away(start), 0.01)


def joints(robot: franka.Robot, **options: Any) -> None:
    """Every joint there and back."""
    start = robot.read_once().q
    with robot.joint_targets(fraction=0.2, **options) as arm:
        for offset in (STEP_RAD, 0.0):
            goal = start + offset * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])
            arm.move_to(goal)
            assert settles(lambda goal=goal: np.abs(arm.state().q - goal).max(), 0.03)


def torques(robot: franka.Robot) -> None:
    """The client's own impedance, in torques: a pose and joints."""
    cartesian(robot)
    joints(robot)


def motions(robot: franka.Robot) -> None:
    """The robot's controllers, given poses and joint positions."""
    cartesian(robot, backend="robot")
    joints(robot, backend="robot")


def refused(robot: franka.Robot) -> None:
    """A target beyond a joint's end is the client's own error, and the robot is still served."""
    said = ""
    try:
        with robot.joint_targets() as arm:
            arm.move_by([0.0] * 6 + [3.0])
            time.sleep(0.1)
    except franka.FrankaError as error:
        said = str(error)
    assert "joint 7" in said, said
    assert robot.read_once().robot_mode == "idle"


PARTS = {part.__name__: part for part in (state, torques, motions, refused)}


if __name__ == "__main__":
    robot = franka.Robot(sys.argv[1], realtime="ignore")
    robot.set_collision_behavior_simple([40.0] * 7, [40.0] * 7, [40.0] * 6, [40.0] * 6)
    for name in sys.argv[2:] or PARTS:
        PARTS[name](robot)
        print(name, flush=True)
