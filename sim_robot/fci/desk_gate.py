"""What a box's Desk lets its FCI do: with FCI off it refuses every connection, with locked brakes every motion.

libfranka calls the first "Connection to FCI refused", the second "command not possible in the current mode (Other)".
"""

import numpy as np

from hal.state import RobotMode
from sim_robot.fci.arm_server import ArmServer


class DeskGate:
    """Between the FLAGS of a box (sim_robot.desk.flags) and its arm. `look` is called each millisecond."""

    def __init__(self, flags: np.void, arm_server: ArmServer) -> None:
        self._flags, self._arm_server = flags, arm_server
        self._locked = False  # by Desk: a scripted fault shows the same mode

    def look(self) -> None:
        """Follow what Desk was told, and tell it what the arm does."""
        flags, server = self._flags, self._arm_server
        mode = server.box.mode
        flags["moving"] = mode == RobotMode.MOVE
        flags["user_stop"] = mode == RobotMode.USER_STOPPED
        if not flags["fci"]:
            server.preempt()
        server.link.listen(bool(flags["fci"]))
        if flags["locked"] and mode in (RobotMode.IDLE, RobotMode.MOVE):
            server.preempt()
            server.lock_brakes()
            self._locked = True
        elif self._locked and not flags["locked"]:
            self._locked = False
            if mode == RobotMode.OTHER:
                server.unlock_brakes()
