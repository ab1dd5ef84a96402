"""A joint motion, a Cartesian motion and back, as franky-control's own examples do it. Prints how exact they were."""

import sys

import franky
import numpy as np


def main(address: str) -> None:
    """Move the arm at this address."""
    robot = franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
    robot.recover_from_errors()
    robot.relative_dynamics_factor = 0.2
    start = np.array(robot.current_joint_state.position)
    goal = start + 0.1 * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])
    robot.move(franky.JointMotion(list(goal)))
    joint_error = np.abs(np.array(robot.current_joint_state.position) - goal).max()
    before = robot.current_cartesian_state.pose.end_effector_pose.translation
    robot.move(franky.CartesianMotion(franky.Affine([0.0, 0.0, -0.05]), franky.ReferenceType.Relative))
    after = robot.current_cartesian_state.pose.end_effector_pose.translation
    robot.move(franky.JointMotion(list(start)))
    return_error = np.abs(np.array(robot.current_joint_state.position) - start).max()
    print(joint_error, np.linalg.norm(after - before), return_error)


if __name__ == "__main__":
    main(sys.argv[1])
