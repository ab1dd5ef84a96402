"""Two arms in one loop: started together, and each awaited by its own socket."""

import select
import time

from hal.cell import LEFT, RIGHT
from hal.errors import ConnectionLost
from hal.fci.arm import FciArm
from hal.fci.setup import CollisionBehaviour, Tool

# A robot without commands stops itself after 20 ms; five times that without a state is no hiccup of a network any more.
STALE_S = 0.1


class FciPair:
    """Two connected arms: a hal.cell.ArmLink."""

    def __init__(self, left: FciArm, right: FciArm) -> None:
        self.left, self.right = left, right
        self._epoll = select.epoll()
        self._epoll.register(left.socket, select.EPOLLIN)
        self._epoll.register(right.socket, select.EPOLLIN)
        self._sides = {left.socket: LEFT, right.socket: RIGHT}
        self._arms = {LEFT: left, RIGHT: right}
        self._due_s = {LEFT: 0.0, RIGHT: 0.0}  # when an arm that has sent nothing is stale

    def start(self) -> None:
        """Take torque control of both, one right after the other. Raises CommandRejected, ConnectionLost.

        While the right arm starts, the left one gets no answer: about 2 of the 20 packets that it may lose.
        """
        try:
            self.left.start()
            self.right.start()
        except BaseException:
            self.left.stop()
            raise
        self._due_s = dict.fromkeys(self._due_s, time.monotonic() + STALE_S)

    def wait(self) -> int:
        """Block until a state has arrived that was not read; return the mask of LEFT and RIGHT whose `read` returns at
        once. Raises ConnectionLost when an arm has sent nothing for STALE_S.
        """
        mask = 0
        for descriptor, _ in self._epoll.poll(STALE_S):
            mask |= self._sides[descriptor]
        now_s = time.monotonic()
        for side, due_s in self._due_s.items():
            if mask & side:
                self._due_s[side] = now_s + STALE_S
            elif now_s > due_s:
                address = self._arms[side].address
                raise ConnectionLost(f"the arm at {address} has sent no state for {1e3 * STALE_S:.0f} ms")
        return mask

    def close(self) -> None:
        """Stop both arms and disconnect."""
        self._epoll.close()
        self.left.close()
        self.right.close()


def open_pair(
    left_address: str,
    right_address: str,
    tool: Tool | None = None,
    collisions: CollisionBehaviour | None = None,
    *,
    enforce_realtime: bool = False,
) -> FciPair:
    """Connect to both arms, which carry the same tool. Raises what FciArm raises, and leaves nothing open then."""
    left = FciArm(left_address, tool, collisions, enforce_realtime=enforce_realtime)
    try:
        right = FciArm(right_address, tool, collisions, enforce_realtime=enforce_realtime)
    except BaseException:
        left.close()
        raise
    return FciPair(left, right)
