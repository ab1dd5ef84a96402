"""The arms of one loop, one or two: started together, each awaited by its own socket, none left alone while the other
one is slow.

A call to libfranka that the control box has to carry out lasts as long as the box takes, and nothing else of this
process runs meanwhile. The other arm, where it is in motion, is held by hal.fci.hold for that time.

A thread that sleeps in a read is woken some 50 to 100 us late, more on a virtual machine. So it sleeps until shortly
before the next state is due, and then looks without sleeping, for a fifth of the time at most.
"""

import select
import time
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext

from hal.cell import LEFT, RIGHT
from hal.errors import ConnectionLost, HardwareError, RecoveryRefused
from hal.fci.arm import FciArm
from hal.fci.cycle_times import CycleTimes
from hal.fci.hold import HoldThread
from hal.fci.peeked_state import PeekedState
from hal.limits import CollisionBehaviour
from hal.pad import Pad
from hal.state import RobotMode

# A robot without commands stops itself after 20 ms; five times that without a state is no hiccup of a network any more.
STALE_S = 0.1
# a robot that waits for us loses nothing by a pause: there only a dead one is stale
STALE_IN_LOCKSTEP_S = 5.0
MOST_REPEATS = 10  # of a state, until both arms show the same one
# a wait that one arm has ended counts at most this much for the other one's silence: the rest was ours
LONGEST_WAIT_S = 5e-3
PERIOD_NS = 1_000_000
EARLY_NS = 120_000  # what timers and wake-ups may take
LATE_NS = 100_000  # a state that is later than this is waited for asleep


class StateWatch:
    """Watches sockets (descriptors) on which a state arrives every millisecond."""

    def __init__(self, descriptors: Iterable[int]) -> None:
        self._epoll = select.epoll()
        self._due_ns = dict.fromkeys(descriptors, 0)
        for descriptor in self._due_ns:
            self._epoll.register(descriptor, select.EPOLLIN)
        self._wait_list = [self._epoll]

    def wait(self, timeout_s: float) -> list[int]:
        """Return the descriptors that can be read: as soon as there is one, none after about `timeout_s`."""
        poll, clock = self._epoll.poll, time.monotonic_ns
        now_ns = clock()
        due_ns = min((due for due in self._due_ns.values() if due > now_ns - LATE_NS), default=now_ns)
        spare_ns = due_ns - EARLY_NS - now_ns
        if spare_ns > 0:
            # epoll alone rounds to milliseconds; select on the epoll's own descriptor does not
            select.select(self._wait_list, (), (), spare_ns * 1e-9)
        events = poll(0)
        while not events and clock() < due_ns + LATE_NS:
            events = poll(0)
        events = events or poll(timeout_s)
        now_ns = clock()
        ready = [descriptor for descriptor, _ in events]
        for descriptor in ready:
            self._due_ns[descriptor] = now_ns + PERIOD_NS
        return ready

    def close(self) -> None:
        self._epoll.close()


class FciPair:
    """One or two connected arms: a hal.cell.ArmLink.

    left, right: None for an arm that is not there. arms: those that are, by their bit of the mask. cycles: of each arm,
    where it is answered by its own clock.
    """

    def __init__(self, left: FciArm | None, right: FciArm | None, *, shared_clock: bool = False) -> None:
        self.left, self.right = left, right
        self._shared_clock = shared_clock
        self._stale_s = STALE_IN_LOCKSTEP_S if shared_clock else STALE_S
        there = [arm for arm in (left, right) if arm is not None]
        self.arms: dict[int, FciArm] = dict(zip((LEFT, RIGHT), there, strict=False))
        self._watch: StateWatch | None = None  # of the arms' present sockets, by the next `wait`
        self._sides: dict[int, int] = {}
        self._silent_s = dict.fromkeys(self.arms, 0.0)  # how long we have waited without a state of that arm
        self._hold_thread = HoldThread()
        for arm in self.arms.values():
            if not shared_clock:
                arm.peeked = PeekedState(arm.state)
                arm.cycles = CycleTimes(arm.peeked)
            self._hold_thread.hold(arm)  # compiled, or loaded from the cache, before an arm moves
            arm.reconnected = self._forget_sockets
        self.cycles = tuple(arm.cycles for arm in self.arms.values() if arm.cycles is not None) or None
        self._watch_sockets()

    def _watch_sockets(self) -> StateWatch:
        self._sides = {arm.socket: side for side, arm in self.arms.items()}
        self._watch = StateWatch(self._sides)
        return self._watch

    def _forget_sockets(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None

    def holding(self, arm: FciArm) -> AbstractContextManager[object]:
        """Return the context for a call to an arm that may take long: the other one, if it is in motion, goes on with
        its last command. A robot that waits for its answer (lockstep) needs no help."""
        other = next((each for each in self.arms.values() if each is not arm), None)
        if other is None or self._shared_clock or not other.in_motion:
            return nullcontext()
        return self._hold_thread.hold(other)

    def start(self) -> None:
        """Take torque control of all, one right after the other. Raises CommandRejected, ConnectionLost."""
        try:
            for arm in self.arms.values():
                with self.holding(arm):
                    arm.start()
            if self._shared_clock:
                self._meet()
        except BaseException:
            next(iter(self.arms.values())).stop()
            raise
        self._silent_s = dict.fromkeys(self.arms, 0.0)

    def set_collisions(self, *arms: CollisionBehaviour) -> None:
        """Tell the arms, which are idle, the thresholds of the next motion; see hal.cell.ArmLink."""
        for arm, collisions in zip(self.arms.values(), arms, strict=True):
            arm.set_collisions(collisions)

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End the motion of all, see hal.cell.ArmLink.

        Where they do not stand still, a robot that is slow to end the first one's motion leaves the second one without
        answers, and it stops by itself. Never raises.
        """
        for side in sorted(self.arms, reverse=first == RIGHT):
            arm = self.arms[side]
            with self.holding(arm) if at_rest else nullcontext():
                arm.stop()

    def recover(self) -> tuple[str, ...]:
        """Recover the arms that are in reflex, see hal.cell.ArmLink."""
        done: list[str] = []
        failed: list[HardwareError] = []
        begun = []
        for arm in self.arms.values():
            try:
                begun.append((arm, arm.begin_recovery()))
            except HardwareError as error:
                failed.append(error)
        for arm, recovery in begun:  # both boxes take their time at once
            try:
                if recovery is not None:
                    arm.end_recovery(*recovery)
                    done.append(f"{arm.called} has recovered from {', '.join(recovery[1])}")
            except HardwareError as error:
                failed.append(error)
        for error in failed:
            if not isinstance(error, RecoveryRefused):
                raise error
        if failed:
            raise RecoveryRefused("; ".join([*done, *map(str, failed)]))
        return tuple(done)

    def _meet(self) -> None:
        """Leave both arms with the same state to be read: a robot that waits repeats it until it is answered, and one
        that an arm has shown while it was still idle is read once more."""
        arms = list(self.arms.values())
        states = [arm.read() for arm in arms]
        for _ in range(MOST_REPEATS):
            idle = [k for k, state in enumerate(states) if state.robot_mode is not RobotMode.MOVE]
            if not idle and states[0].t_ns == states[-1].t_ns:
                break
            behind = idle[0] if idle else int(states[-1].t_ns < states[0].t_ns)
            states[behind] = arms[behind].read()
        for arm in arms:
            arm.unread = True

    def wait(self) -> int:
        """Block until a state has arrived that was not read; return the mask of LEFT and RIGHT whose `read` returns at
        once. Raises ConnectionLost, which names the arm, when one has sent nothing for STALE_S."""
        unread = sum(side for side, arm in self.arms.items() if arm.unread)
        if unread:
            return unread
        watch = self._watch or self._watch_sockets()
        began_ns = time.monotonic_ns()
        for cycles in self.cycles or ():
            cycles.free_ns = began_ns
        mask = 0
        while not mask:
            mask = self._wait(watch, began_ns)
            began_ns = time.monotonic_ns()
        return mask

    def _wait(self, watch: StateWatch, began_ns: int) -> int:
        """Return whose states have arrived, 0 where only other datagrams have. Raises as `wait` does."""
        # a second look: where this process itself was held up, the states are there by now
        ready = watch.wait(self._stale_s) or watch.wait(LONGEST_WAIT_S)
        waited_s = min(1e-9 * (time.monotonic_ns() - began_ns), LONGEST_WAIT_S) if ready else self._stale_s
        mask = sum(side for side in (self._sides[each] for each in ready) if self.arms[side].arrived())
        for side, silent_s in self._silent_s.items():
            self._silent_s[side] = 0.0 if mask & side else silent_s + waited_s
        # all of them, before one is told: a stop that is sent to a silent arm would never return
        lost = [
            self.arms[side].lose(f"has sent no state for {1e3 * self._stale_s:.0f} ms")
            for side, silent_s in self._silent_s.items()
            if silent_s >= self._stale_s
        ]
        if lost:
            raise ConnectionLost("; ".join(map(str, lost)))
        return mask

    def close(self) -> None:
        self._forget_sockets()
        self._hold_thread.close()
        for arm in self.arms.values():
            arm.close()


def open_pair(
    left_address: str | None, right_address: str | None, tools: tuple[Pad | None, Pad | None] = (None, None),
    collisions: CollisionBehaviour | None = None, *, shared_clock: bool = False, enforce_realtime: bool = False,
) -> FciPair:  # fmt: skip
    """Connect to the arms, with what each of them carries; None: there is no such arm.

    shared_clock: they are of one robot that waits for answers (lockstep), and their first states are to be the same.
    Raises what FciArm raises, and leaves nothing open then.
    """
    opened: list[FciArm | None] = []
    try:
        for name, address, tool in zip(("left arm", "right arm"), (left_address, right_address), tools, strict=True):
            arm = None
            if address is not None:
                arm = FciArm(address, tool, collisions, name=name, enforce_realtime=enforce_realtime)
            opened.append(arm)
    except BaseException:
        for arm in filter(None, opened):
            arm.close()
        raise
    return FciPair(*opened, shared_clock=shared_clock)
