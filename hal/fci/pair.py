"""Two arms in one loop: started together, each awaited by its own socket, none left alone while the other one is slow.

A call to libfranka that the control box has to carry out lasts as long as the box takes, and nothing else of this
process runs meanwhile. The other arm, where it is in motion, is held by hal.fci.hold for that time.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from hal.arrays import Array
from hal.cell import LEFT, RIGHT
from hal.collisions import CollisionBehaviour
from hal.errors import ConnectionLost, HardwareError, RecoveryRefused
from hal.fci.arm import FciArm
from hal.fci.cycle_times import CycleTimes
from hal.fci.hold import HoldThread
from hal.fci.motion import move
from hal.fci.setup import Tool
from hal.fci.watch import StateWatch
from hal.joint_path import JointSpeed
from hal.state import RobotMode

# A robot without commands stops itself after 20 ms; five times that without a state is no hiccup of a network any more.
STALE_S = 0.1
# a robot that waits for us loses nothing by a pause: there only a dead one is stale
STALE_IN_LOCKSTEP_S = 5.0
MOST_REPEATS = 10  # of a state, until both arms show the same one
# a wait that one arm has ended counts at most this much for the other one's silence: the rest was ours
LONGEST_WAIT_S = 5e-3


class FciPair:
    """Two connected arms: a hal.cell.ArmLink. cycles: of both arms, where each of them is answered by its own clock."""

    def __init__(self, left: FciArm, right: FciArm, *, shared_clock: bool = False) -> None:
        self.left, self.right = left, right
        self._shared_clock = shared_clock
        self._stale_s = STALE_IN_LOCKSTEP_S if shared_clock else STALE_S
        self._arms = {LEFT: left, RIGHT: right}
        self._watch: StateWatch | None = None  # of the arms' present sockets, by the next `wait`
        self._sides: dict[int, int] = {}
        self._silent_s = {LEFT: 0.0, RIGHT: 0.0}  # how long we have waited without a state of that arm
        self.cycles = None if shared_clock else (CycleTimes(left.state), CycleTimes(right.state))
        left.cycles, right.cycles = self.cycles or (None, None)
        self._hold_thread = HoldThread()
        for arm in (left, right):
            self._hold_thread.hold(arm)  # compiled, or loaded from the cache, before an arm moves
            arm.reconnected = self._forget_sockets
        self._watch_sockets()

    def _watch_sockets(self) -> StateWatch:
        self._sides = {arm.socket: side for side, arm in self._arms.items()}
        self._watch = StateWatch(self._sides)
        return self._watch

    def _forget_sockets(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None

    def holding(self, arm: FciArm) -> AbstractContextManager[object]:
        """Return the context for a call to an arm that may take long: the other one, if it is in motion, goes on with
        its last command. A robot that waits for its answer (lockstep) needs no help.
        """
        other = self.right if arm is self.left else self.left
        return nullcontext() if self._shared_clock or not other.in_motion else self._hold_thread.hold(other)

    def start(self) -> None:
        """Take torque control of both, one right after the other. Raises CommandRejected, ConnectionLost."""
        try:
            self.left.start()
            with self.holding(self.right):
                self.right.start()
            if self._shared_clock:
                self._meet()
        except BaseException:
            self.left.stop()
            raise
        self._silent_s = {LEFT: 0.0, RIGHT: 0.0}

    def set_collisions(self, left: CollisionBehaviour, right: CollisionBehaviour) -> None:
        """Tell both arms, which are idle, the thresholds of the next motion; see hal.cell.ArmLink."""
        self.left.set_collisions(left)
        self.right.set_collisions(right)

    def move(self, goal: Array, limit: JointSpeed, stop: Callable[[], bool]) -> bool:
        """Move both arms to goal (2, 7) rad; see hal.cell.ArmLink."""
        self._silent_s = {LEFT: 0.0, RIGHT: 0.0}
        return move(self, goal, limit, stop)

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End the motion of both; first: LEFT or RIGHT, whose turn is before the other's. Never raises.

        at_rest: both stand still, so that the second one may go on with its last torque meanwhile. Otherwise a robot
        that is slow to end the first one's motion leaves the second one without answers, and it stops by itself.
        """
        for arm in (self._arms[first], self._arms[(LEFT | RIGHT) ^ first]):
            with self.holding(arm) if at_rest else nullcontext():
                arm.stop()

    def recover(self) -> tuple[str, ...]:
        """Recover whichever arm is in reflex, both before saying no; return one line for each that was.

        Raises RecoveryRefused with the reasons of all that refuse, ConnectionLost.
        """
        done: list[str] = []
        refused: list[str] = []
        lost: list[HardwareError] = []
        begun = []
        for arm in (self.left, self.right):
            try:
                begun.append((arm, arm.begin_recovery()))
            except RecoveryRefused as error:
                refused.append(str(error))
            except HardwareError as error:
                lost.append(error)
        for arm, recovery in begun:  # both boxes take their time at once
            if recovery is None:
                continue
            try:
                arm.end_recovery(*recovery)
            except RecoveryRefused as error:
                refused.append(str(error))
            except HardwareError as error:
                lost.append(error)
            else:
                done.append(f"{arm.called} has recovered from {', '.join(recovery[1])}")
        if lost:
            raise lost[0]
        if refused:
            raise RecoveryRefused("; ".join(done + refused))
        return tuple(done)

    def _meet(self) -> None:
        """Leave both arms with the same state to be read: a robot that waits repeats it until it is answered.

        An arm may have shown that state while it was still idle: then it is read once more.
        """
        arms = (self.left, self.right)
        states = [arm.read() for arm in arms]
        for _ in range(MOST_REPEATS):
            idle = [k for k, state in enumerate(states) if state.robot_mode is not RobotMode.MOVE]
            if not idle and states[0].t_ns == states[1].t_ns:
                break
            behind = idle[0] if idle else int(states[1].t_ns < states[0].t_ns)
            states[behind] = arms[behind].read()
        self.left.unread = self.right.unread = True

    def wait(self) -> int:
        """Block until a state has arrived that was not read; return the mask of LEFT and RIGHT whose `read` returns at
        once. Raises ConnectionLost, which names the arm, when one has sent nothing for STALE_S.
        """
        if self.left.unread or self.right.unread:
            return LEFT * self.left.unread | RIGHT * self.right.unread
        watch = self._watch or self._watch_sockets()
        began_ns = time.monotonic_ns()
        if self.cycles is not None:
            self.cycles[0].free_ns = self.cycles[1].free_ns = began_ns
        # a second look: where this process itself was held up, the states are there by now
        ready = watch.wait(self._stale_s) or watch.wait(LONGEST_WAIT_S)
        waited_s = min(1e-9 * (time.monotonic_ns() - began_ns), LONGEST_WAIT_S) if ready else self._stale_s
        mask = 0
        for descriptor in ready:
            mask |= self._sides[descriptor]
        for side, silent_s in self._silent_s.items():
            self._silent_s[side] = 0.0 if mask & side else silent_s + waited_s
        # all of them, before one is told: a stop that is sent to a silent arm would never return
        lost = [
            self._arms[side].lose(f"has sent no state for {1e3 * self._stale_s:.0f} ms")
            for side, silent_s in self._silent_s.items()
            if silent_s >= self._stale_s
        ]
        if lost:
            raise ConnectionLost("; ".join(map(str, lost)))
        return mask

    def close(self) -> None:
        """Stop both arms and disconnect."""
        self._forget_sockets()
        self._hold_thread.close()
        self.left.close()
        self.right.close()


def open_pair(
    left_address: str,
    right_address: str,
    tools: tuple[Tool | None, Tool | None] = (None, None),
    collisions: CollisionBehaviour | None = None,
    *,
    shared_clock: bool = False,
    enforce_realtime: bool = False,
) -> FciPair:
    """Connect to both arms, with what each of them carries. Raises what FciArm raises, and leaves nothing open then.

    shared_clock: both are of one robot that waits for answers (lockstep): their first states are to be the same one.
    """
    left = FciArm(left_address, tools[0], collisions, name="left arm", enforce_realtime=enforce_realtime)
    try:
        right = FciArm(right_address, tools[1], collisions, name="right arm", enforce_realtime=enforce_realtime)
    except BaseException:
        left.close()
        raise
    return FciPair(left, right, shared_clock=shared_clock)
