"""The order of calls of libfranka's grasp_object example, over pylibfranka. Prints a line for each that went well."""

import sys
import time

import pylibfranka as franka

WIDTH = 0.05  # m, of the block


def main(address: str) -> None:
    """Home, look at the largest width, grasp, hold for a while, let go."""
    gripper = franka.Gripper(address)
    assert gripper.server_version() == 3
    assert gripper.read_once().max_width == 0.0
    try:
        gripper.move(WIDTH, 0.1)
    except franka.CommandException as error:
        print("not homed:", error)
    assert gripper.homing()
    assert gripper.read_once().max_width > WIDTH
    assert gripper.grasp(WIDTH, 0.1, 60.0)
    print("grasped")
    time.sleep(0.5)
    state = gripper.read_once()
    assert state.is_grasped, "object lost"
    assert abs(state.width - WIDTH) < 1e-3
    assert gripper.stop()
    assert not gripper.grasp(0.02, 0.1, 60.0), "something else was grasped"
    assert not gripper.read_once().is_grasped
    assert gripper.move(0.08, 0.1)
    print("let go at", round(gripper.read_once().width, 4))


if __name__ == "__main__":
    main(sys.argv[1])
