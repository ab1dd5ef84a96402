"""The pace of tests and batch work: the plant goes on when every moving arm has answered.

Deterministic for a client program, whatever the machine does:
- The plant stands still while no client moves an arm; states go on at 1 kHz of wall-clock time under rising ids.
- After Move the plant stands still, and states go on ever more slowly, until each moving arm has answered once.
- Then a state is shown to all at once, idle arms first, and the plant waits for the answers of moving arms. One whose
  client has gone, or is silent for LONGEST_WAIT_S, loses packets, as on the robot, until the reflex.
- An asynchronous motion and a hand's go on at 1 kHz of wall-clock time, unless an arm's answers set the pace.
- After the last motion the plant comes to rest by itself; its last answer, a Move and a recovery wait for that.
"""

import time
from collections.abc import Callable

import numpy as np

from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.server import Server

IDLE_PERIOD_S = 1e-3
SEEN_MS = 200  # of the plant, until a tracker that is late has shown where the object was put
# between two states before the first answer: the client's start takes one, its first read another one; a third one is
# for a client that took both at its start, and late enough not to meet an answer on its way
FIRST_REPEATS_S = (1e-3, 50e-3, 100e-3)
# The message id jumps at Move, so that the second arm, idle and thus streaming meanwhile, can start with the same id.
JUMP = 1000
# no answer for so long, of wall-clock time: the client hangs. What a debugger stops is a hung client too.
LONGEST_WAIT_S = 10.0
AT_REST = 2e-3  # rad/s and m/s
LONGEST_REST_MS = 1000
REST_CHUNK_MS = 20


class Lockstep:
    """Serves until `stopped` says so."""

    def __init__(self, server: Server, longest_wait_s: float = LONGEST_WAIT_S) -> None:
        """A client that moves an arm is waited for so long at most."""
        self._server, self._longest_wait_s = server, longest_wait_s
        self._heard_s = time.monotonic()  # since when an awaited client owes an answer
        self._hung: list[ArmServer] = []
        self._in_step: list[ArmServer] = []  # whose clients have answered: their time goes on by 1 ms a state
        for arm_server in server.arm_servers:
            arm_server.patient = True
        self._rest_ms = 0  # how long the plant has been left alone since the last motion
        self._resting = False
        self._idle_due_s = 0.0
        self._tidied_s = time.monotonic()
        self._were_moving = tuple(False for _ in server.arm_servers)

    def run(self, stopped: Callable[[], bool]) -> None:
        server = self._server
        while not stopped():
            server.look_at_desk()
            self._note_changes()
            if self._resting:
                server.poller.serve(0.0)
                self._rest()
                continue
            moving = [arm_server for arm_server in server.arm_servers if arm_server.moving]
            if (moving or server.hands_move) and not self._waits(moving) and self._due(moving):
                self._step()
                continue
            server.poller.serve(self._wait_s())
            self._note_changes()
            self._repeat(time.monotonic())

    def _waits(self, moving: list[ArmServer]) -> bool:
        """True while a responsive client owes an answer."""
        now = time.monotonic()
        if self._hung:
            self._server.poller.serve(0.0)  # an answer after all
        self._hung = [arm_server for arm_server in self._hung if arm_server.awaited]
        awaited = [arm_server for arm_server in moving if arm_server.awaited and arm_server not in self._hung]
        if not awaited:
            self._heard_s = now
        elif now - self._heard_s > self._longest_wait_s:
            self._hung += awaited
            self._heard_s, awaited = now, []
        return bool(awaited)

    def _due(self, moving: list[ArmServer]) -> bool:
        """True if answers set the pace, or the ms is over."""
        return not all(arm_server.asynchronous for arm_server in moving) or time.monotonic() >= self._idle_due_s

    def _note_changes(self) -> None:
        """See motions that began or ended: show it at once, and let the plant come to rest after the last one."""
        moving = tuple(arm_server.moving for arm_server in self._server.arm_servers)
        if moving == self._were_moving:
            return
        if not any(moving):
            self._begin_rest()
        for arm_server in self._server.arm_servers:
            arm_server.hold_replies = self._resting
        for arm_server, now, before in zip(self._server.arm_servers, moving, self._were_moving, strict=True):
            if now != before:
                self._in_step = [other for other in self._in_step if other is not arm_server]
            if now and not before:
                self._heard_s = time.monotonic()  # no client owed an answer before
                others = [other for other in self._server.arm_servers if other.moving and other is not arm_server]
                jump = 0 if others else JUMP
                arm_server.message_id = max(
                    [arm_server.message_id + jump, *(o.message_id + max(0, 2 - o.repeats) - 2 for o in others)]
                )
            elif before and not now:
                arm_server.show_new()
        self._were_moving = moving

    def _begin_rest(self) -> None:
        self._resting, self._rest_ms, self._server.deferring = True, 0, True

    def _step(self) -> None:
        server, arm_servers, hands_moved = self._server, self._server.arm_servers, self._server.hands_move
        server.advance()
        self._note_changes()
        for arm_server in arm_servers:
            if not arm_server.moving:
                arm_server.show_new()
        moving = [arm_server for arm_server in arm_servers if arm_server.moving]
        in_step = [arm_server for arm_server in moving if arm_server in self._in_step]
        newest = max((arm_server.message_id for arm_server in in_step or moving), default=0)
        for arm_server in moving:
            if arm_server not in in_step:  # one clock: it takes over that of the others, whose clients are under way
                arm_server.message_id = max(arm_server.message_id, newest)
            arm_server.show_new()
        self._in_step = moving
        # the answer to a hand's motion that ended while no arm moves waits for the plant's rest too
        if hands_moved and not server.hands_move and not any(arm_server.moving for arm_server in arm_servers):
            self._begin_rest()
        if not self._resting:
            server.settle_grippers()
        server.show_grippers()
        self._idle_due_s = time.monotonic() + IDLE_PERIOD_S

    def _rest(self) -> None:
        server = self._server
        for _ in range(REST_CHUNK_MS):
            server.advance()
            self._rest_ms += 1
            still = np.abs(server.cell.plant.data.qvel).max() < AT_REST
            if (still and self._rest_ms >= REST_CHUNK_MS) or self._rest_ms >= LONGEST_REST_MS:
                self._resting = False
                break
        for arm_server in server.arm_servers:
            arm_server.hold_replies = self._resting
            arm_server.show_new()
        if not self._resting:
            server.resume_requests()
            server.settle_grippers()

    def _wait_s(self) -> float:
        arm_servers, now = self._server.arm_servers, time.monotonic()
        due: list[float] = []
        due += [arm_server.repeat_due_s for arm_server in arm_servers if arm_server.moving and not arm_server.joined]
        served = [arm_server for arm_server in arm_servers if arm_server.link.client is not None]
        if any(not arm_server.moving or arm_server.asynchronous for arm_server in served) or self._server.hands_in_use:
            due.append(self._idle_due_s)
        return max(0.0, min(due) - now) if due else 0.1

    def _repeat(self, now: float) -> None:
        """Show the same state of the plant again to who may be waiting for one before it answers."""
        arm_servers = self._server.arm_servers
        for arm_server in arm_servers:
            if arm_server.moving and not arm_server.joined and now >= arm_server.repeat_due_s:
                arm_server.show()
                arm_server.repeat_due_s = now + FIRST_REPEATS_S[min(arm_server.repeats, len(FIRST_REPEATS_S) - 1)]
                arm_server.repeats += 1
        clocked = self._server.hands_move or any(arm_server.asynchronous for arm_server in arm_servers)
        if now >= self._idle_due_s and not clocked:
            for arm_server in arm_servers:
                if not arm_server.moving:
                    arm_server.show()
            self._server.show_grippers()
            if not any(arm_server.moving for arm_server in arm_servers):
                self._server.repeat_pose()
            if self._server.tidy(now - self._tidied_s):
                for _ in range(SEEN_MS):
                    self._server.advance()
            self._tidied_s = now
            self._idle_due_s = now + IDLE_PERIOD_S
