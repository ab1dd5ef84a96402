"""The operator's input for teleoperation: the clutch (deadman switch), the requested poses, and the only writer of the
mailbox's target.

Only the holder of the lease moves the arms, and only while a teleoperation runs; the robot process checks each target
again. May be called from any thread.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from console.teleoperation.devices import Deflected, Device, Dragged
from console.teleoperation.pair import Coupling
from console.teleoperation.quaternion import angle_between
from console.watch import Watch
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import Job, JobKind, JobState
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET, Release
from rtstack.loop.watchdogs import CLUTCH_S
from rtstack.teleoperation.reach import (
    AHEAD_M,
    AHEAD_RAD,
    FASTEST_M_S,
    HARDEST_N_M,
    SLOWEST_M_S,
    SOFTEST_N_M,
    SPEED_M_S,
    STIFFNESS_N_M,
    TURN_RAD_M,
)

Array = NDArray[np.float64]
TOO_FAR = "the request is too far ahead of the arm: it is not followed until it comes nearer"


@dataclass(frozen=True, slots=True)
class TeleopView:
    """What a page shows of the input. refusal: why the last request is not followed, None where it is."""

    held: bool
    coupling: Coupling
    speed_m_s: float
    stiffness_n_m: float
    refusal: str | None


class TeleopInput:
    """The input for both arms."""

    def __init__(self, mailbox: Mailbox, watch: Watch, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._lock = threading.RLock()
        self._mailbox = mailbox
        self._watch = watch
        self._clock = clock
        self._target = np.zeros(1, TARGET)
        self._by: str | None = None  # who holds the clutch
        self._asked: Array | None = None
        self._grips: dict[int, tuple[Array, Array]] = {}  # of the gizmos that are dragged: where grip and hands began
        self._jogged_ns = 0
        self._coupling = Coupling.SEPARATE
        self._speed = SPEED_M_S
        self._stiffness = STIFFNESS_N_M
        self._refusal: str | None = None

    @property
    def view(self) -> TeleopView:
        """How things are now."""
        with self._lock:
            self._notice()
            return TeleopView(self._by is not None, self._coupling, self._speed, self._stiffness, self._refusal)

    @property
    def running(self) -> bool:
        """Whether a teleoperation runs."""
        return self._job() is not None

    def asked(self) -> Array | None:
        """Return what is asked for, (2, 7); while the clutch is not held the last command of the arms; None before."""
        with self._lock:
            self._notice()
            return self._asked if self._by is not None else self._watch.command()

    def dragging(self, side: int) -> bool:
        """Whether this arm's gizmo is being dragged."""
        return side in self._grips

    def set(
        self, operator: str, coupling: Coupling | None = None, speed_m_s: float | None = None,
        stiffness_n_m: float | None = None,
    ) -> None:  # fmt: skip
        """Set coupling, speed and stiffness. Raises RobotRefused unless the operator is the holder."""
        with self._lock:
            self._check_holder(operator)
            self._coupling = coupling or self._coupling
            if speed_m_s is not None:
                self._speed = float(np.clip(speed_m_s, SLOWEST_M_S, FASTEST_M_S))
            if stiffness_n_m is not None:
                self._stiffness = float(np.clip(stiffness_n_m, SOFTEST_N_M, HARDEST_N_M))
            if self._by is not None:
                self._grips.clear()  # what is dragged goes on from here, in the new way
                self._write()

    def press(self, operator: str) -> None:
        """Hold the clutch, or give a sign of life of one that is held. Raises RobotRefused with the reason."""
        with self._lock:
            self._check_holder(operator)
            job = self._job()
            if job is None:
                raise RobotRefused("no teleoperation runs: start one")
            self._notice()
            if self._by is None:
                command = self._watch.command()
                if command is None:
                    raise RobotRefused("the arms have not said yet where they are")
                self._asked, self._by, self._refusal = command, operator, None
                self._grips.clear()
                self._target["release"], self._target["finish"] = Release.NOT_YET, 0
            self._target["job"] = job.number
            self._target["clutch_ns"] = self._clock()
            self._write()

    def release(self, operator: str, reason: Release = Release.RELEASED) -> None:
        """Release the clutch. Does nothing where this operator does not hold it."""
        with self._lock:
            if self._by is None or self._by != operator:
                return
            self._by = None
            self._grips.clear()
            self._target["clutch_ns"], self._target["release"] = 0, reason
            self._write()

    def finish(self, operator: str) -> None:
        """End the teleoperation or the playback softly. Raises RobotRefused unless the operator is the holder."""
        with self._lock:
            self._check_holder(operator)
            job = self._job(JobKind.TELEOPERATION, JobKind.PLAYBACK)
            if job is None:
                raise RobotRefused("neither a teleoperation nor a playback runs")
            self._by = None
            self._target["job"], self._target["clutch_ns"], self._target["finish"] = job.number, 0, 1
            self._write()

    def move(self, operator: str, device: Device) -> None:
        """Ask for what a device says. Raises RobotRefused unless this operator holds the clutch."""
        with self._lock:
            self._notice()
            if self._by != operator or self._asked is None:
                raise RobotRefused("hold the clutch: nothing moves without it")
            self._ask(device)

    def jog(self, operator: str, left: Array | None, right: Array | None) -> None:
        """Ask for what keys or sticks say, for the time since they last did. Raises RobotRefused as `move` does."""
        now_ns = self._clock()
        elapsed_s, self._jogged_ns = (now_ns - self._jogged_ns) * 1e-9, now_ns
        self.move(operator, Deflected(left, right, elapsed_s, self._speed, TURN_RAD_M * self._speed))

    def drag(self, side: int, grip: Array, phase: str) -> None:
        """Take a gizmo's pose (7,). Only the holder's messages get as far as this (console.scene_gate)."""
        with self._lock:
            self._notice()
            if phase == "end" or self._by is None or self._asked is None:
                self._grips.pop(side, None)
                return
            if phase == "start" or side not in self._grips:
                self._grips[side] = (grip, self._asked.copy())
            grip_began, began = self._grips[side]
            self._ask(Dragged(side, grip_began, grip, began))

    def _ask(self, device: Device) -> None:
        assert self._asked is not None
        asked = device.requests(self._asked, self._coupling)
        self._refusal = self._why_not(asked)
        if self._refusal is None:
            self._asked = asked
            self._write()

    def _why_not(self, asked: Array) -> str | None:
        command = self._watch.command()
        if not np.isfinite(asked).all() or (np.abs(np.linalg.norm(asked[:, 3:], axis=1) - 1.0) > 1e-3).any():
            return "the request is no pose"
        if command is None:
            return "the arms have not said yet where they are"
        for want, now in zip(asked, command, strict=True):
            if np.linalg.norm(want[:3] - now[:3]) > AHEAD_M or angle_between(want[3:], now[3:]) > AHEAD_RAD:
                return TOO_FAR
        return None

    def _write(self) -> None:
        if self._asked is not None:
            self._target["pose"][0] = self._asked
        self._target["speed"], self._target["stiffness"] = self._speed, self._stiffness
        self._mailbox.write_target(self._target)

    def _notice(self) -> None:
        """Notice that the clutch went quiet, or that what it was held for is over: the robot has, long ago."""
        quiet = self._clock() - int(self._target["clutch_ns"][0]) > CLUTCH_S * 1e9
        if self._by is not None and (quiet or self._job() is None):
            self._by = None
            self._grips.clear()

    def _check_holder(self, operator: str) -> None:
        status = self._watch.view.status
        holder = None if status is None else status.holder
        if holder != operator:
            raise RobotRefused(f"{holder or 'no operator'} has control; take control first")

    def _job(self, *kinds: JobKind) -> Job | None:
        status = self._watch.view.status
        job = None if status is None else status.job
        kinds = kinds or (JobKind.TELEOPERATION,)
        runs = job is not None and job.kind in kinds and job.state is JobState.RUNNING
        return job if runs else None
