"""A leader arm: a person moves its joints, and the pads go as its hands go, from where both were.

The protocol, for any program that reads such arms: datagrams (UDP, to this machine), each one line of JSON,

    {"sequence": 17, "held": true, "left": [seven joint angles], "right": [seven joint angles]}

in rad, counted as the follower's joints (a leader is a small copy of it, as in Wu et al., GELLO, 2023); `held` is its
switch or pedal, and `"finished": true` ends it. A datagram that is no such line, or comes after a later one, changes
nothing.

    rtstack teleoperate leader:7700 --console ADDRESS --token TOKEN
    python -m joint_tracking.leader 7700      # in the place of a real one: both hands go up by some cm, and down again
"""

import json
import math
import socket
import sys
import time
from typing import Any

import numpy as np

from hal.base.arrays import Array
from rtstack.cells import load_description
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import ArmMounting, base_poses
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.teleoperation.device import HandInput, Pose

PORT, PERIOD_S, SILENT_S = 7700, 0.02, 0.1


class Leader:
    """An rtstack.teleoperation.device.InputDevice. argument: the port. A leader that is silent lets go."""

    def __init__(self, argument: str) -> None:
        description, _ = load_description(None)
        self._arms = tuple(zip(description.arms, base_poses(description), strict=True))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", int(argument or PORT)))
        self._socket.setblocking(False)
        self._newest, self._sequence, self._heard_s = HandInput(held=False), -1, -math.inf

    def read(self) -> HandInput:
        """Return what the operator does now."""
        while True:
            try:
                said = self._socket.recv(4096)
            except BlockingIOError:
                break
            try:
                self._take(json.loads(said))
            except (ValueError, KeyError, TypeError):
                continue  # it is no word of a leader
        return self._newest if time.monotonic() - self._heard_s < SILENT_S else HandInput(held=False)

    def _take(self, said: dict[str, Any]) -> None:
        joints = np.array([said["left"], said["right"]], dtype=float)
        if joints.shape != (2, 7) or not np.isfinite(joints).all() or not said["sequence"] > self._sequence:
            return
        self._sequence, self._heard_s = said["sequence"], time.monotonic()
        left, right = (self._hand(arm, q) for arm, q in zip(self._arms, joints, strict=True))
        self._newest = HandInput(bool(said["held"]), left, right, bool(said.get("finished")), leading=True)

    def _hand(self, arm: tuple[ArmMounting, Array], q: Array) -> Pose:
        mounting, T_world_base = arm
        T = T_world_base @ flange_pose(mounting.robot, q)
        wxyz = np.zeros(4)
        quaternion_from_rotation(np.ascontiguousarray(T[:3, :3]), wxyz)
        (x, y, z), (w, i, j, k) = T[:3, 3].tolist(), wxyz.tolist()
        return x, y, z, w, i, j, k

    def close(self) -> None:
        """Release the device."""
        self._socket.close()


def simulated(port: int, rest_s: float = 2.0, swing_s: float = 4.0) -> None:
    """Be a leader that rests at the follower's home, and then swings both shoulders there and back once."""
    description, _ = load_description(None)
    home = description.home
    to, began_s = ("127.0.0.1", port), time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for sequence in range(1, round((2.0 * rest_s + swing_s) / PERIOD_S) + 1):
            share = min(1.0, max(0.0, (PERIOD_S * sequence - rest_s) / swing_s))
            q = home.copy()
            q[:, 1] -= 0.06 * (1.0 - math.cos(2.0 * math.pi * share))  # rad, of the shoulder
            last = PERIOD_S * sequence >= 2.0 * rest_s + swing_s
            left, right = q.tolist()
            word = {"sequence": sequence, "held": not last, "left": left, "right": right, "finished": last}
            out.sendto(json.dumps(word).encode(), to)
            time.sleep(max(0.0, began_s + PERIOD_S * sequence - time.monotonic()))


if __name__ == "__main__":
    simulated(int(sys.argv[1]) if len(sys.argv) > 1 else PORT)
