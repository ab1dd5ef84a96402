"""What a real client makes of a server's bytes: prints RobotState as JSON, and then sends one torque command."""

import json
import os
import sys

import pylibfranka as franka

TORQUES = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def fields(state: object) -> dict[str, object]:
    """Return every field; enumerations as numbers, errors as the list of their names."""
    found = {}
    for name in dir(state):
        value = getattr(state, name)
        if isinstance(value, franka.Errors):
            found[name] = [error for error in dir(value) if getattr(value, error) is True]
        elif name == "time":
            found[name] = round(1e3 * value.to_sec())
        elif name == "robot_mode":
            found[name] = value.value
        elif not name.startswith("_"):
            found[name] = value
    return found


def main(address: str) -> None:
    """Talk to the server at `address`. Ends with 1 and what the client says when it refuses the state."""
    try:
        robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    except franka.FrankaException as error:
        sys.exit(str(error))
    print(json.dumps(fields(robot.read_once())), flush=True)
    control = robot.start_torque_control()
    control.readOnce()
    control.writeOnce(franka.Torques(TORQUES))
    os._exit(0)  # without a word to the server, which is only a prop


if __name__ == "__main__":
    main(sys.argv[1])
