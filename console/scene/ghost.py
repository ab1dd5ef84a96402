"""A motion that is shown, and ends at once when anything moves: a trial that was simulated, or the last hit, slowly."""

import threading
import time
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from hal.base.arrays import Array
from rtstack.live.protocol import Job, JobKind, JobState, Status
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.samples import SIDES

AROUND_S = 0.1  # of the first impact, before it and after it
SLOWLY = 0.05  # of the robot's time: the 200 ms last 4 s
STAYS_S = 1.5  # at its end
STEP_S = 0.002  # between two poses that are kept


class Shown(StrEnum):
    """What the ghost is."""

    PREVIEW = "preview"
    REPLAY = "replay"


@dataclass(frozen=True, slots=True)
class Motion:
    """t_s (n,) since the first sample, q (n, 2, 7) rad, the object's name and its poses (n, 7), None: never seen."""

    t_s: Array
    q: Array
    object: str
    object_poses: Array | None


@dataclass(frozen=True, slots=True)
class GhostView:
    """What is shown, at which of how many s of the motion, at which share of its speed; impact_s: None without one."""

    shown: Shown
    t_s: float
    end_s: float
    speed: float
    impact_s: float | None


def motion_of(log: Log, start_s: float = 0.0, end_s: float = np.inf) -> Motion:
    """Return what both arms and the object did in a part of a log. Raises LogError where there is nothing."""
    arms = [log.topic(f"/{side}/arm") for side in SIDES]
    if min(len(samples) for samples in arms) < 2:
        raise LogError(f"{log.path}: it has no samples of both arms")
    zero_ns = int(arms[0]["t_ns"][0])
    times = (arms[0]["t_ns"] - zero_ns) * 1e-9
    t_s = np.arange(max(start_s, 0.0), min(end_s, float(times[-1])), STEP_S)
    rows = [np.searchsorted(samples["t_ns"], zero_ns + t_s * 1e9).clip(max=len(samples) - 1) for samples in arms]
    q = np.stack([samples["q"][row] for samples, row in zip(arms, rows, strict=True)], axis=1)
    poses, placed = log.topic("/object/pose"), None
    poses = poses[poses["seen"] != 0]
    if len(poses):
        row = (np.searchsorted(poses["t_ns"], zero_ns + t_s * 1e9, side="right") - 1).clip(min=0)
        placed = np.concatenate([poses["position"][row], poses["orientation_wxyz"][row]], axis=1)
    return Motion(t_s, q, str(log.metadata.get("trial", {}).get("object", "")), placed)


class GhostPlayer:
    """Plays one motion at a time. May be used from any thread."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._play: tuple[GhostView, Motion, float] | None = None  # and when it began, monotonic s
        self._replayed = -1  # the newest job whose end was looked at
        self._looked = False  # at the robot: what had ended before is not shown
        self._moves = False

    def play(self, motion: Motion, shown: Shown, speed: float = 1.0, impact_s: float | None = None) -> None:
        """Show a motion from its start, unless something moves."""
        if not self._moves and len(motion.t_s):
            end_s = float(motion.t_s[-1])
            self._play = GhostView(shown, float(motion.t_s[0]), end_s, speed, impact_s), motion, time.monotonic()

    def end(self) -> None:
        """Show nothing any more."""
        self._play = None

    def watch(self, status: Status | None) -> None:
        """Learn how things are: what moves ends the ghost, and a trial that has ended is shown once more, slowly."""
        job = None if status is None else status.job
        self._moves = job is not None and job.active
        if self._moves:
            self.end()
        if status is None:
            return
        if job is None or job.active or job.number == self._replayed:
            self._looked = True
            return
        looked, self._looked, self._replayed = self._looked, True, job.number
        if looked and job.kind is JobKind.TRIAL and job.state is JobState.DONE and job.log is not None:
            threading.Thread(target=self._replay, args=(job, job.log), daemon=True, name="replay").start()

    def _replay(self, job: Job, name: str) -> None:
        try:
            log = read_log(self._logs / name)
            found = float(log.metadata.get("result", {}).get("detected_impact_time_s", "null"))
            motion = motion_of(log, found - AROUND_S, found + AROUND_S)
        except (LogError, ValueError):  # not readable, or nothing was met
            return
        if job.number == self._replayed:
            self.play(motion, Shown.REPLAY, SLOWLY, found)

    @property
    def view(self) -> GhostView | None:
        """What is shown now."""
        if (play := self._play) is None:
            return None
        begun, _, began_s = play
        at_s = begun.t_s + (time.monotonic() - began_s) * begun.speed
        if at_s > begun.end_s + STAYS_S * begun.speed:
            self._play = None
            return None
        return replace(begun, t_s=min(at_s, begun.end_s))

    def pose(self) -> tuple[Array, str, Array | None] | None:
        """Return joints (2, 7), the object's name and its pose (7,), as they are shown now; None for nothing."""
        play, view = self._play, self.view
        if play is None or view is None:
            return None
        motion, at = play[1], int(np.searchsorted(play[1].t_s, view.t_s))
        row = min(at, len(motion.t_s) - 1)
        return motion.q[row], motion.object, None if motion.object_poses is None else motion.object_poses[row]
