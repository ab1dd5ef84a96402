"""The operator's input for teleoperation: the clutch (deadman switch), the requested poses, and the only writer of the
mailbox's target.

Only the holder of the lease moves the arms, and only while a teleoperation runs; the robot process checks each target
again. May be called from any thread.
"""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from math import inf

import numpy as np

from console.live.watch import Watch
from console.teleoperation.devices import Coupling, Grips, OfArms, deflected, refusal, straightened, towards
from console.teleoperation.gate import OLDEST_COMMAND_S, Admission, Drop, Gate
from console.teleoperation.policies import Policies
from console.teleoperation.teleop_view import Handles, Latency, Lead, TeleopView
from hal.base.arrays import Array
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import Job, JobKind, JobState
from rtstack.loop.mailbox import TARGET, Mailbox, Release
from rtstack.loop.watchdogs import CLUTCH_S
from rtstack.samples import SIDES
from rtstack.teleoperation import reach
from rtstack.teleoperation.hand_motion import HandMotion
from rtstack.teleoperation.stamp import Stamp

NO_CLUTCH = "the clutch is not held, so that nothing moves: hold C while you drag, or let the drag hold the clutch"
_LED = (JobKind.TELEOPERATION, JobKind.GUIDE)
BEAT_S = 0.05  # between two signs of life of a page


class TeleopInput:
    """The input for the arms of a cell, one or two."""

    def __init__(self, mailbox: Mailbox, watch: Watch, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._lock = threading.RLock()
        self._mailbox, self._watch, self._clock = mailbox, watch, clock
        self._target = np.zeros(1, TARGET)
        self._target["pose"] = np.nan  # what stays in the row of an arm that is not there
        first = SIDES.index(watch.sides[0])
        self._rows = slice(first, first + len(watch.sides))  # of the arms that are there
        self._by: str | None = None  # who holds the clutch
        self._asked: Array | None = None
        self._grips = Grips()
        self._motion = HandMotion(watch.sides)
        self._dropped: str | None = None  # why the grip was let go for the operator, who has to open it
        self._grip: tuple[str, int] | None = None  # who lets a drag hold the clutch, and when they last said so
        self._by_grip = False  # the clutch is held by a drag
        self._goal: tuple[Lead, Array] | None = None  # where the hands are being led
        self._of_job: int | None = None
        self._coupling, self._handles = Coupling.SEPARATE, Handles.MOVE
        self._speed, self._stiffness = reach.SPEED_M_S, reach.STIFFNESS_N_M
        self._refusal: str | None = None
        self.policies = Policies()
        self._gate = Gate()
        self._admitted: Admission | None = None  # the last one that was a sign of life
        self._admitted_ns = self._jogged_ns = 0
        self._late: str | None = None  # why the last command was not applied
        self._latency = Latency(watch.rings)

    @property
    def view(self) -> TeleopView:
        """How things are now."""
        with self._lock:
            self._notice()
            asked, goal = self._asked, self._goal
            leads = self._by is not None
            return TeleopView(
                self._by is not None, self._coupling, self._speed, self._stiffness,
                self._dropped or self._late or self._refusal or self.policies.refused,
                self._handles, len(self._grips.drags), tuple(self._gate.dropped), self._latency.view(),
                self._watch.view.number, self.policies.leads, self.policies.names,
                leads and asked is not None and goal is not None and not np.allclose(asked, goal[1], atol=1e-4),
            )  # fmt: skip

    @property
    def running(self) -> bool:
        """Whether a teleoperation runs."""
        return self._job(JobKind.TELEOPERATION) is not None

    def asked(self) -> Array | None:
        """Return what is asked for, (arms, 7); while the clutch is not held the arms' last command; None before."""
        with self._lock:
            self._notice()
            return self._asked if self._by is not None else self._watch.command()

    def dragging(self, side: int) -> bool:
        """Whether this arm's gizmo is being dragged, with the clutch or without."""
        return side in self._grips.dragged

    def set(
        self, operator: str, coupling: Coupling | None = None, speed_m_s: float | None = None,
        stiffness_n_m: float | None = None, handles: Handles | None = None,
    ) -> None:  # fmt: skip
        """Set how the arms follow, and what the gizmos do. Raises RobotRefused, as for two arms where there is one."""
        with self._lock:
            self._check_holder(operator)
            if len(self._watch.sides) == 1 and coupling not in (None, Coupling.SEPARATE):
                known = f"the cell has one: leave it {Coupling.SEPARATE}"
                raise RobotRefused(f"coupling {coupling} takes two arms, and {known}")
            self._coupling = coupling or self._coupling
            self._handles = handles or self._handles
            if speed_m_s is not None:
                self._speed = float(np.clip(speed_m_s, reach.SLOWEST_M_S, reach.FASTEST_M_S))
            if stiffness_n_m is not None:
                self._stiffness = float(np.clip(stiffness_n_m, reach.SOFTEST_N_M, reach.HARDEST_N_M))
            if self._by is not None or self.policies.leads is not None:
                self._grips.let_go()  # what is dragged goes on from here, in the new way
                self._write()

    def admit(self, operator: str, stamp: Stamp | None, came_ns: int | None = None) -> Admission:
        """Judge a command before all else: the gate of all devices. came_ns: when it came. Raises RobotRefused."""
        with self._lock:
            self._check_holder(operator)
            self._notice()
            now_ns = time.monotonic_ns()
            picture_ns = None if stamp is None else self._watch.picture_ns(stamp.picture)
            admission = self._gate.admit(operator, stamp, picture_ns, now_ns)
            self._late = f"not applied: {admission.text}" if admission.drop is not None else None
            self._target["dropped"] = self._gate.dropped
            if admission.drop is None and stamp is not None:
                self._motion.advance(stamp, came_ns or now_ns)
            if admission.alive:
                self._admitted, self._admitted_ns = admission, self._clock()
                self._target["came_ns"] = came_ns or now_ns
                for name in ("sequence", "made_ns", "picture", "picture_ns", "seen_ns"):
                    self._target[name] = getattr(admission, name)
            return admission

    def press(self, operator: str, made_ns: int | None = None, lead: Lead | None = None) -> None:
        """Hold the clutch, or give a sign of life of one that is held. Raises RobotRefused with the reason.

        made_ns: when it was given, None for now: one that was long under way does not keep the arms going for longer.
        lead: what leads the hands meanwhile; the next one after none begins anew.
        """
        with self._lock:
            job = self._running(operator)
            self._notice()
            self._goal = self._goal if lead else None
            if self._by is None:
                if self._dropped is not None:
                    raise RobotRefused(self._dropped)
                command = self._watch.command()
                if command is None and job.kind is JobKind.TELEOPERATION:  # others follow no request
                    raise RobotRefused("the arms have not said yet where they are")
                self._asked, self._by, self._by_grip = command, operator, False
                self._refusal = self._goal = None
                self._lead_nothing()
                self._target["release"], self._target["finish"] = Release.NOT_YET, 0
                self._target["policy"] = self.policies.give(None)
            self._write(job=job.number, clutch_ns=self._made_ns(made_ns))

    def grip(self, operator: str, made_ns: int | None = None) -> None:
        """Say that a mouse button is down: a drag by it holds the clutch. Raises RobotRefused as `press`."""
        with self._lock:
            self._check_holder(operator)
            self._grip = operator, self._made_ns(made_ns)
            if self._grips.dragged:
                self._press_by_grip(*self._grip)

    def _made_ns(self, made_ns: int | None) -> int:
        now_ns = self._clock()
        return now_ns if made_ns is None else min(made_ns, now_ns)

    def _press_by_grip(self, operator: str, made_ns: int) -> None:
        if self._by is None or self._by_grip:
            self.press(operator, made_ns)
            self._by_grip = True

    def release(self, operator: str, reason: Release = Release.RELEASED) -> None:
        """Release the clutch. Does nothing where this operator does not hold it."""
        with self._lock:
            if self._grip is not None and self._grip[0] == operator:
                self._grip = None
            if reason is Release.RELEASED and operator == self._holder:  # what is lost has not been opened
                self._dropped = None
            if self._by == operator:
                self._by = None
                self._lead_nothing()
                self._write(clutch_ns=0, release=reason)

    def drop(self, operator: str, why: str | None) -> None:
        """Let go of a clutch until its operator releases it. why: None for no reason. Raises RobotRefused with it."""
        if why is not None:
            with self._lock:
                if self._by == operator:
                    self.release(operator, Release.DROPPED)
                    self._dropped = f"{why}: the grip was let go; open it, then take it again"
                raise RobotRefused(self._dropped or why)

    def _lead_nothing(self) -> None:
        self._grips.let_go()
        self._motion.forget()

    def finish(self, operator: str) -> None:
        """End the teleoperation or the playback softly. Raises RobotRefused unless the operator is the holder."""
        with self._lock:
            refusal = "neither a teleoperation nor a playback runs"
            job = self._running(operator, JobKind.TELEOPERATION, JobKind.PLAYBACK, refusal=refusal)
            self._by = self.policies.leads = None
            self._write(job=job.number, clutch_ns=0, finish=1)

    def lend(self, operator: str, policy: str | None) -> None:
        """Let a policy lead until the clutch is held, or none any more. Raises RobotRefused with the reason."""
        with self._lock:
            job = self._running(operator, JobKind.TELEOPERATION)
            if policy == operator:
                raise RobotRefused(f"{operator} has control: a policy has a name and a token of its own")
            self._notice()
            self._by = None
            self._lead_nothing()
            given = self.policies.give(policy)
            self._write(job=job.number, clutch_ns=0, finish=0, release=Release.NOT_YET, policy=given)

    def end_lease(self, policy: str) -> None:
        """End the lease of a policy that has gone or is done: the arms hold. Does nothing where it has none."""
        with self._lock:
            if self.policies.leads == policy:
                self._write(policy=self.policies.give(None))

    def lease(self, policy: str) -> tuple[int, int] | None:
        """Return the job and the number of the lease that this policy has, None where it has none."""
        with self._lock:
            self._notice()
            if self.policies.leads != policy:
                return None
            return int(self._target["job"][0]), int(self._target["policy"][0])

    def sense(self, operator: str, sensed: OfArms) -> None:
        """Judge poses that a sender has made its message from, by a filter or a scale. Raises RobotRefused."""
        with self._lock:
            self._held_request(operator)
            self.drop(operator, self._motion.problem("sensor", sensed))

    def move(self, operator: str, poses: OfArms) -> None:
        """Ask for poses, (7,) each, as they are: who gives poses couples them. None: that hand stays.

        Raises RobotRefused unless this operator holds the clutch, and where a hand cannot have moved so: see `drop`.
        """
        with self._lock:
            asked = self._held_request(operator)
            self.drop(operator, self._motion.problem("pose", poses, inf))  # a program may give one a second
            self._ask(np.array([now if pose is None else pose for now, pose in zip(asked, poses, strict=True)]))

    def track(self, operator: str, hands: OfArms) -> None:
        """Let each arm's pad go as the hand that leads it, (7,), or None. Raises RobotRefused as `move` does."""
        with self._lock:
            asked = self._held_request(operator)
            self.drop(operator, self._motion.problem("hand", hands))
            self._ask(self._grips.track(hands, asked, self._coupling, self._motion.paused is not None))
            self._refusal = self._refusal or self._motion.paused

    def jog(self, operator: str, deflections: OfArms) -> None:
        """Ask for what keys or sticks say of each arm, (6,), since they last did. Raises RobotRefused as `move`."""
        pace = self._pace()
        with self._lock:
            self._ask(deflected(self._held_request(operator), deflections, *pace, self._coupling))

    def lead(self, operator: str, lead: Lead) -> None:
        """Lead the hands, for the time since this was last said. Raises RobotRefused, as without a drag to undo."""
        pace = self._pace()
        with self._lock:
            asked = self._held_request(operator)
            if self._goal is None or self._goal[0] is not lead:
                drags = self._grips.drags
                if lead is Lead.UNDO and not drags:
                    raise RobotRefused("no drag of this teleoperation is left to be undone")
                self._goal = lead, drags.pop() if lead is Lead.UNDO else straightened(asked)
            self._ask(towards(asked, self._goal[1], *pace))

    def _held_request(self, operator: str) -> Array:
        """Return what is asked for. Raises RobotRefused unless this operator holds the clutch."""
        self._notice()
        if self._by != operator or self._asked is None:
            raise RobotRefused("hold the clutch: nothing moves without it")
        return self._asked

    def _pace(self) -> tuple[float, float, float]:
        """Return the time since the last call, s, and the speeds, m/s and rad/s."""
        before_ns, self._jogged_ns = self._jogged_ns, self._clock()
        return (self._jogged_ns - before_ns) * 1e-9, self._speed, reach.TURN_RAD_M * self._speed

    def drag(self, side: int, grip: Array, phase: str) -> None:
        """Take a gizmo's pose (7,): console.routes.scene lets the holder's through. side: place in the arrays."""
        with self._lock:
            self._notice()
            if phase == "end":
                self._grips.end_drag(side, self._asked)
                if self._by_grip and self._by is not None and not self._grips.dragged:
                    self.release(self._by)
                return
            self._grips.dragged.add(side)
            if self._drag_is_late():
                return
            if self._by is None and self._grip is not None and self._clock() - self._grip[1] < CLUTCH_S * 1e9:
                with suppress(RobotRefused):  # the page is told by its next sign of life
                    self._press_by_grip(*self._grip)
            if self._by is None or self._asked is None:
                self._grips.let_go(side)
                self._refusal = NO_CLUTCH
                return
            self._ask(self._grips.drag(side, grip, self._asked, phase == "start", self._coupling))

    def _drag_is_late(self) -> bool:
        """Whether a drag must not be followed: it has the stamp of the last sign of life, which comes the same way."""
        if self._by is None or self._admitted is None:
            return False
        if self._clock() - self._admitted_ns > (OLDEST_COMMAND_S + BEAT_S) * 1e9:
            drop, self._late = Drop.OLD, "not applied: no sign of life has come with the drag"
        elif (drop := self._admitted.drop) is None:
            return False
        self._gate.dropped[drop] += 1
        return True

    def _ask(self, asked: Array) -> None:
        self._refusal = refusal(asked, self._watch.command())
        if self._refusal is None:
            self._asked = asked
            self._write()

    def _write(self, **fields: int) -> None:
        """Write the target with what is asked for, and these fields of it anew."""
        for name, value in fields.items():
            self._target[name] = value
        if self._asked is not None:
            self._target["pose"][0, self._rows] = self._asked
        self._target["speed"], self._target["stiffness"] = self._speed, self._stiffness
        self._mailbox.write_target(self._target)

    def _notice(self) -> None:
        """Notice that the clutch went quiet, or that what it was held for is over: the robot has, long ago."""
        quiet = self._clock() - int(self._target["clutch_ns"][0]) > CLUTCH_S * 1e9
        if self._by is not None and (quiet or self._job() is None):
            self._by = None
            self._lead_nothing()
        number = getattr(self._job(), "number", None)
        if number != self._of_job:  # what was dragged before is another teleoperation's
            self._of_job = number
            self._refusal = self._late = self._dropped = self.policies.leads = self.policies.refused = None
            self._grips.drags.clear()
            self._gate.forget()
            self._latency.forget()

    def _check_holder(self, operator: str) -> None:
        if self._holder != operator:
            raise RobotRefused(f"{self._holder or 'no operator'} has control; take control first")

    @property
    def _holder(self) -> str | None:
        return getattr(self._watch.view.status, "holder", None)

    def _running(self, operator: str, *kinds: JobKind, refusal: str = "no teleoperation runs: start one") -> Job:
        """Return the holder's job of these kinds. Raises RobotRefused."""
        self._check_holder(operator)
        if (job := self._job(*kinds)) is None:
            raise RobotRefused(refusal)
        return job

    def _job(self, *kinds: JobKind) -> Job | None:
        status = self._watch.view.status
        if status is None or (job := status.job) is None or job.state is not JobState.RUNNING:
            return None
        # without kinds: for which a clutch is held, on real arms for every motion
        return job if job.kind in (kinds or (_LED if status.simulated else JobKind)) else None
