"""The arms of one loop, one or two: started together, each awaited by its own socket, none left alone while the other
one is slow.

A call to libfranka that the control box has to carry out lasts as long as the box takes, and nothing else of this
process runs meanwhile. The other arm, where it is in motion, is held by hal.fci.hold for that time.

Waiting for the states of several arms without sleeping through the moment when they come.

A thread that sleeps in a read is woken some 50 to 100 us late, more on a virtual machine. States come every
millisecond: so it sleeps until shortly before the next one is due, and then looks without sleeping, for a fifth of the
time at most, which is far from what the kernel takes from a real-time thread that never rests.
"""

import select
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from hal.base.arrays import Array
from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected, ConnectionLost, HardwareError, RecoveryRefused
from hal.fci.arm import FciArm
from hal.fci.cycle_times import CycleTimes
from hal.fci.hold import HoldThread
from hal.fci.peeked_state import PeekedState
from hal.joint_path import JointPath, JointSpeed
from hal.limits import CONTROL_PERIOD_S, CollisionBehaviour
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
BRAKE_S = 0.3  # from full speed to rest after a stop request: 2.5 rad/s^2 at 0.5 rad/s
SETTLE_S = 0.2  # the last posture is held this long before the motion is ended
LONG_GAP_S = 5e-3  # worth a word where the robot has ended the motion
LONGEST_STEP_S = 0.02  # of one answer: after 20 ms without one the robot has ended the motion by itself


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
        """Release the descriptor."""
        self._epoll.close()


class _Progress:
    """How far one arm is on the way. t_s: its time on it; still_s: how long it has been at its end."""

    def __init__(self) -> None:
        self.t_s = self.still_s = self.braking_s = 0.0
        self.stamp_ns = -1
        self.longest_gap_s = 0.0  # between two answers, by the robot's clock
        self._answers = 0

    def step(self, t_ns: int, end_s: float, stopping: bool) -> None:
        """Go on to a new state's time."""
        gap_s = 1e-9 * (t_ns - self.stamp_ns) if self._answers else 0.0
        step_s = min(gap_s, LONGEST_STEP_S)
        self.longest_gap_s = max(self.longest_gap_s, gap_s if self._answers > 1 else 0.0)
        if self._answers == 1:  # a robot that waits for us has shown its first state several times
            step_s = CONTROL_PERIOD_S
        self.stamp_ns, self._answers = t_ns, self._answers + 1
        self.braking_s += step_s if stopping else 0.0
        x = min(self.braking_s / BRAKE_S, 1.0)
        self.t_s += step_s * (1.0 - (3.0 - 2.0 * x) * x * x)
        self.still_s += step_s if x >= 1.0 or self.t_s >= end_s else 0.0


class FciPair:
    """One or two connected arms: a hal.cell.ArmLink. cycles: of each arm, where it is answered by its own clock.

    left, right: None for an arm that is not there. arms: those that are, by their bit of the mask.
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
        cycles = tuple(arm.cycles for arm in self.arms.values() if arm.cycles is not None)
        self.cycles = cycles or None
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
        its last command. A robot that waits for its answer (lockstep) needs no help.
        """
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

    def move(self, goal: Array, limit: JointSpeed, stop: Callable[[], bool]) -> bool:
        """Move the arms to goal (arms, 7) rad by their own joint position controllers; see hal.cell.ArmLink.

        Each arm is answered when its own state arrives. After a stop request time runs slower and slower, so that all
        stay on the way. They begin where the robot wants them to be (q_d), which differs from where they are by the sag
        of its controller. Raises CommandRejected and ConnectionLost; then no arm moves any more.
        """
        self._silent_s = dict.fromkeys(self.arms, 0.0)
        arms = self.arms
        progress = {side: _Progress() for side in arms}
        rows = {side: row for row, side in enumerate(arms)}  # of the path
        begins: dict[int, Array] = {}
        path: JointPath | None = None
        stopping = False
        try:
            for arm in arms.values():
                with self.holding(arm):
                    arm.start_positions()
            moving = set(arms)
            while moving:
                stopping = stopping or stop()
                mask = self.wait()
                # an arm may be ended as soon as all stand still, but only as the answer to a state of its own
                ending = path is not None and all(one.still_s >= SETTLE_S for one in progress.values())
                for side in [side for side in moving if mask & side]:
                    t_ns, q_d = arms[side].read_position()
                    begins.setdefault(side, q_d)
                    if path is None and len(begins) == len(arms):
                        path = JointPath.between(np.array([begins[each] for each in arms]), goal, limit)
                    if path is None:
                        arms[side].write_position(begins[side])
                        continue
                    progress[side].step(t_ns, path.duration_s, stopping)
                    posture = path.at(progress[side].t_s)[rows[side]]
                    if not ending:
                        arms[side].write_position(posture)
                        continue
                    with self.holding(arms[side]):
                        arms[side].write_position(posture, finished=True)
                    moving.discard(side)
        except CommandRejected as error:
            gap_s = max(one.longest_gap_s for one in progress.values())
            if gap_s < LONG_GAP_S:
                raise
            # the robot goes on along a parabola meanwhile, and finds our way elsewhere when it is back
            passed = f"up to {1e3 * gap_s:.0f} ms had passed between two of our answers"
            raise CommandRejected(f"{error} ({passed}: keep the host for the loop)", error.errors) from None
        finally:
            self.stop()
        assert path is not None
        return all(one.t_s >= path.duration_s for one in progress.values())

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End the motion of all, see hal.cell.ArmLink. Never raises.

        Where they do not stand still, a robot that is slow to end the first one's motion leaves the second one without
        answers, and it stops by itself.
        """
        for side in sorted(self.arms, reverse=first == RIGHT):
            arm = self.arms[side]
            with self.holding(arm) if at_rest else nullcontext():
                arm.stop()

    def recover(self) -> tuple[str, ...]:
        """Recover the arms that are in reflex, see hal.cell.ArmLink."""
        done: list[str] = []
        refused: list[str] = []
        lost: list[HardwareError] = []
        begun = []
        for arm in self.arms.values():
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
        once. Raises ConnectionLost, which names the arm, when one has sent nothing for STALE_S.
        """
        unread = sum(side for side, arm in self.arms.items() if arm.unread)
        if unread:
            return unread
        watch = self._watch or self._watch_sockets()
        began_ns = time.monotonic_ns()
        for cycles in self.cycles or ():
            cycles.free_ns = began_ns
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
            self.arms[side].lose(f"has sent no state for {1e3 * self._stale_s:.0f} ms")
            for side, silent_s in self._silent_s.items()
            if silent_s >= self._stale_s
        ]
        if lost:
            raise ConnectionLost("; ".join(map(str, lost)))
        return mask

    def close(self) -> None:
        """Stop the arms and disconnect."""
        self._forget_sockets()
        self._hold_thread.close()
        for arm in self.arms.values():
            arm.close()


def open_pair(
    left_address: str | None,
    right_address: str | None,
    tools: tuple[Pad | None, Pad | None] = (None, None),
    collisions: CollisionBehaviour | None = None,
    *,
    shared_clock: bool = False,
    enforce_realtime: bool = False,
) -> FciPair:
    """Connect to the arms, with what each of them carries; None: there is no such arm. Raises what FciArm raises, and
    leaves nothing open then.

    shared_clock: the arms are of one robot that waits for answers (lockstep): their first states are to be the same.
    """
    opened: list[FciArm | None] = []
    try:
        for name, address, tool in zip(("left", "right"), (left_address, right_address), tools, strict=True):
            arm = None
            if address is not None:
                arm = FciArm(address, tool, collisions, name=f"{name} arm", enforce_realtime=enforce_realtime)
            opened.append(arm)
    except BaseException:
        for arm in opened:
            if arm is not None:
                arm.close()
        raise
    return FciPair(*opened, shared_clock=shared_clock)
