"""The pace of tests and batch work: the plant goes on when every moving arm has answered.

Deterministic for a client program, whatever the machine does:
- The plant stands still while no client moves an arm. States go on at 1 kHz of wall-clock time under rising message
  ids, so an idle server sleeps most of the time, and without any client it only wakes up for new connections.
- After Move, states go on (slower and slower) and the plant stands still until each moving arm has answered once.
- Then a state is shown to all at once, idle arms first, and the plant waits for every moving arm's answer, idle ones
  never. A moving arm whose client has gone, or has not answered for LONGEST_WAIT_S, is not waited for: it loses
  packets, as on the robot, until the reflex.
- An asynchronous motion (targets now and then, no answers) and a hand's go on at 1 kHz of wall-clock time, unless
  an arm's answers set the pace.
- When the last motion ends, an arm's or a hand's, the plant first comes to rest by itself; the answer that ends the
  motion, a Move and a recovery wait for that, so that what a client reads next does not depend on when it reads.
"""

import time
from collections.abc import Callable

import numpy as np

from sim_robot.fci.server import Server
from sim_robot.fci.station import Station

IDLE_PERIOD_S = 1e-3
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
        self._hung: list[Station] = []
        self._in_step: list[Station] = []  # whose clients have answered: their time goes on by 1 ms a state
        for station in server.stations:
            station.patient = True
        self._rest_ms = 0  # how long the plant has been left alone since the last motion
        self._resting = False
        self._idle_due_s = 0.0
        self._tidied_s = time.monotonic()
        self._were_moving = (False, False)
        self._hands_moved = False

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve both arms."""
        server = self._server
        while not stopped():
            self._note_changes()
            if self._resting:
                server.poller.serve(0.0)
                self._rest()
                continue
            moving = [station for station in server.stations if station.moving]
            if (moving or server.hands_move) and not self._waits(moving) and self._due(moving):
                self._step()
                continue
            server.poller.serve(self._wait_s())
            self._note_changes()
            self._repeat(time.monotonic())

    def _waits(self, moving: list[Station]) -> bool:
        """True while a responsive client owes an answer."""
        now = time.monotonic()
        if self._hung:
            self._server.poller.serve(0.0)  # an answer after all
        self._hung = [station for station in self._hung if station.awaited]
        awaited = [station for station in moving if station.awaited and station not in self._hung]
        if not awaited:
            self._heard_s = now
        elif now - self._heard_s > self._longest_wait_s:
            self._hung += awaited
            self._heard_s, awaited = now, []
        return bool(awaited)

    def _due(self, moving: list[Station]) -> bool:
        """True if answers set the pace, or the ms is over."""
        return not all(station.asynchronous for station in moving) or time.monotonic() >= self._idle_due_s

    def _note_changes(self) -> None:
        """See motions that began or ended: show it at once, and let the plant come to rest after the last one."""
        moving = tuple(station.moving for station in self._server.stations)
        if moving == self._were_moving:
            return
        if not any(moving):
            self._begin_rest()
        for station in self._server.stations:
            station.hold_replies = self._resting
        for station, now, before in zip(self._server.stations, moving, self._were_moving, strict=True):
            if now != before:
                self._in_step = [other for other in self._in_step if other is not station]
            if now and not before:
                self._heard_s = time.monotonic()  # no client owed an answer before
                others = [other for other in self._server.stations if other.moving and other is not station]
                jump = 0 if others else JUMP
                station.message_id = max(
                    [station.message_id + jump, *(o.message_id + max(0, 2 - o.repeats) - 2 for o in others)]
                )
            elif before and not now:
                station.show_new()
        self._were_moving = moving

    def _begin_rest(self) -> None:
        self._resting, self._rest_ms, self._server.deferring = True, 0, True

    def _note_hands(self) -> None:
        """See a hand's motion that ended while no arm moves: its answer waits for the plant's rest too."""
        moved, self._hands_moved = self._hands_moved, self._server.hands_move
        if moved and not self._hands_moved and not any(station.moving for station in self._server.stations):
            self._begin_rest()
        if not self._resting:
            self._server.settle_grippers()

    def _step(self) -> None:
        self._hands_moved = self._server.hands_move
        self._server.advance()
        stations = self._server.stations
        self._note_changes()
        for station in stations:
            if not station.moving:
                station.show_new()
        moving = [station for station in stations if station.moving]
        in_step = [station for station in moving if station in self._in_step]
        newest = max((station.message_id for station in in_step or moving), default=0)
        for station in moving:
            if station not in in_step:  # one clock: it takes over that of the others, whose clients are under way
                station.message_id = max(station.message_id, newest)
            station.show_new()
        self._in_step = moving
        self._note_hands()
        self._server.show_grippers()
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
        for station in server.stations:
            station.hold_replies = self._resting
            station.show_new()
        if not self._resting:
            server.resume_requests()
            server.settle_grippers()

    def _wait_s(self) -> float:
        stations, now = self._server.stations, time.monotonic()
        due: list[float] = []
        due += [station.repeat_due_s for station in stations if station.moving and not station.joined]
        served = [station for station in stations if station.link.client is not None]
        if any(not station.moving or station.asynchronous for station in served) or self._server.hands_in_use:
            due.append(self._idle_due_s)
        return max(0.0, min(due) - now) if due else 0.1

    def _repeat(self, now: float) -> None:
        """Show the same state of the plant again to who may be waiting for one before it answers."""
        stations = self._server.stations
        for station in stations:
            if station.moving and not station.joined and now >= station.repeat_due_s:
                station.show()
                station.repeat_due_s = now + FIRST_REPEATS_S[min(station.repeats, len(FIRST_REPEATS_S) - 1)]
                station.repeats += 1
        clocked = self._server.hands_move or any(station.asynchronous for station in stations)
        if now >= self._idle_due_s and not clocked:
            for station in stations:
                if not station.moving:
                    station.show()
            self._server.show_grippers()
            if not any(station.moving for station in stations):
                self._server.repeat_pose()
            self._server.tidy(now - self._tidied_s)
            self._tidied_s = now
            self._idle_due_s = now + IDLE_PERIOD_S
