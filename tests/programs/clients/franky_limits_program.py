"""What franky-control plans with, and a pose 5 cm away at a share of it.

`limits` prints the largest accelerations of translation, rotation and joints; `pose SHARE` prints what came of it, the
joints where it began and the largest acceleration of translation, with bars between.
"""

import sys

import franky
import numpy as np

AWAY = 0.1 * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])


def main(address: str, what: str, share: float = 1.0) -> None:
    """Run it on the arm at this address."""
    robot = franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
    translation, rotation = robot.translation_acceleration_limit, robot.rotation_acceleration_limit
    if what == "limits":
        print(translation.get(), rotation.get(), *robot.joint_acceleration_limit.get())
        return
    robot.recover_from_errors()
    robot.relative_dynamics_factor = 0.2
    robot.move(franky.JointMotion(list(np.array(robot.current_joint_state.position) + AWAY)))
    start = robot.current_joint_state.position
    robot.relative_dynamics_factor = share
    try:
        robot.move(franky.CartesianMotion(franky.Affine([0.05, 0.0, 0.0]), franky.ReferenceType.Relative))
        outcome = "arrived"
    except franky.ControlException as error:
        outcome = str(error)
    print(outcome.replace("\n", " "), "|", *start, "|", translation.get())


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(float, sys.argv[3:]))
