"""Faults between robot and client, and what a user stop looks like there. Used only where a script of faults is run."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from hal.state import NEEDS_PERSON, RobotMode
from hal.wire import ROBOT_STATE
from sim_robot.faults.injection import Injection
from sim_robot.faults.kinds import AnswersLost, Disconnect, Stall, StatesLost
from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.link import Link
from sim_robot.fci.protocol import MoveStatus


class FaultyLink(Link):
    """A link that loses states, distorts them, or hangs up."""

    def __init__(self, *arguments, injection: Injection, side: int, **callbacks) -> None:
        self._injection, self._side, self.wanted = injection, side, True
        super().__init__(*arguments, **callbacks)
        self._sent = np.zeros(1, ROBOT_STATE)
        self._sent_bytes = self._sent.view(np.uint8).data

    @property
    def deaf(self) -> bool:
        """True while the client is sent nothing."""
        return bool(self._injection.schedule.effects(StatesLost, self._side))

    def send_state(self, state: memoryview) -> None:
        """Send one state as the faults show it, unless it is lost."""
        self._sent_bytes[:] = state
        self._injection.distort(self._side, self._sent, "message_id", 1)
        if not self.deaf:
            super().send_state(self._sent_bytes)

    def listen(self, wanted: bool) -> None:
        """As without faults; but while the script has the arm's FCI off, each connection is refused."""
        self.wanted = wanted
        super().listen(wanted and not self._injection.off(self._side))

    def hang_up(self) -> None:
        if self.client is not None:
            self._close(self.client)


class FaultyArmServer(ArmServer):
    """A arm_server whose commands may be lost, and which a user stop or a stall may stop."""

    link: FaultyLink

    def __init__(self, *arguments, injection: Injection, **more) -> None:
        self._injection, self._shown_tick = injection, -1
        super().__init__(*arguments, **more)

    @property
    def unsafe(self) -> bool:
        return self._injection.unsafe(self._side)

    @property
    def awaited(self) -> bool:
        """As without faults; but who was sent nothing cannot answer."""
        return super().awaited and not self.link.deaf

    def take(self, command: np.void) -> None:
        if not self._injection.schedule.effects(AnswersLost, self._side):
            super().take(command)
        elif self.patient and self.moving and self.first_id <= int(command["message_id"]) <= self.message_id:
            # in lockstep the plant goes on as if this one had come too late
            self.first_id = int(command["message_id"]) + 1
            self.answered = self.joined = True

    def judge(self, collisions: int, proximity: int) -> None:
        """Stop as without faults; then hang up or stall where that begins now."""
        super().judge(collisions, proximity)
        for fault in self._injection.schedule.begun:
            if isinstance(fault.effect, Disconnect) and self._side in fault.sides:
                self.link.hang_up()
            if isinstance(fault.effect, Stall) and self._side == 0:
                time.sleep(1e-3 * fault.effect.stall_ms)

    def settle_outcome(self) -> None:
        """Answer the Move request of a motion that a reflex or a user stop has ended."""
        super().settle_outcome()
        if self.box.mode in NEEDS_PERSON and self._move_id is not None:
            self._rest()
            self._end_move(MoveStatus.PREEMPTED_SAFETY if self.unsafe else MoveStatus.EMERGENCY_ABORTED)

    def show(self) -> None:
        """Send the present state. Repeated by a plant that stands still, it lets the active faults go on."""
        ticks = self._cell.plant.ticks
        if self._side == 0:
            if ticks == self._shown_tick and not any(box.mode == RobotMode.MOVE for box in self._cell.boxes):
                self._injection.pass_still_millisecond()
            self._shown_tick = ticks
        self.link.listen(self.link.wanted)  # as the script has the arm's FCI now
        super().show()


def kinds(injection: Injection | None, side: int) -> tuple[Callable[..., Link], Callable[..., ArmServer]]:
    """Return what makes the link and the arm_server of an arm."""
    if injection is None:
        return Link, ArmServer
    return partial(FaultyLink, injection=injection, side=side), partial(FaultyArmServer, injection=injection)
