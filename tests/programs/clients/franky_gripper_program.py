"""The hand with franky-control, as its documentation goes: a grasp of any width, and a stop in the middle of a move."""

import sys

import franky


def main(address: str) -> None:
    """Open, grasp what is there, let go, stop a slow move."""
    gripper = franky.Gripper(address)
    assert gripper.homing()
    assert gripper.open(0.1)
    assert abs(gripper.width - gripper.max_width) < 1e-6
    assert gripper.grasp(0.0, 0.05, 20.0, epsilon_outer=1.0)
    assert gripper.is_grasped
    print("grasped", round(gripper.width, 3))
    assert gripper.open(0.1)
    slow = gripper.move_async(0.055, 0.002)
    while gripper.width > 0.0799:
        continue
    assert gripper.stop()
    assert slow.wait(10.0)
    try:
        slow.get()
    except franky.CommandException as error:
        print("stopped:", error)
    try:
        gripper.move(0.5, 0.1)
    except franky.CommandException as error:
        print("out of range:", error)


if __name__ == "__main__":
    main(sys.argv[1])
