"""The job manager: the requested and the running job. Shared by the loop's thread and the socket's thread.

Every method holds the lock for a few assignments only, so that the loop's thread never waits for a socket.
"""

import os
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

from hal.base.realtime import scheduling
from rtstack.live.audit import AuditTrail
from rtstack.live.control_authority import ControlAuthority
from rtstack.live.first_use import FirstUse
from rtstack.live.protocol import Job, JobKind, JobState, RunRequest, Status
from rtstack.live.source import CellSource
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import Watchdog, WatchdogTrip
from rtstack.safety.arming import Refused
from rtstack.samples import Level
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_two_arms
from rtstack.trials.specification import HandMotion, MoveSpecification, like


class JobManager(Watchdog):
    """Accepts one job at a time, reports its status, and, as a Watchdog, ends a session when the process has to end."""

    def __init__(self, source: CellSource, mailbox: Mailbox, audit: AuditTrail, logs: Path) -> None:
        """logs: the folder of logs."""
        self._source, self._logs, self._mailbox = source, logs, mailbox
        self.authority = ControlAuthority(mailbox, audit)
        self._lock, self._news = threading.Lock(), threading.Event()
        self._order: RunRequest | None = None
        self._recovery: Future[None] | None = None
        self._job: Job | None = None
        self._description = source.description
        self._object = next(iter(source.description.objects))
        self._first_use = FirstUse(len(source.description.sides))
        self._ending: WatchdogTrip | None = None

    # -- the socket's side

    def order(self, request: RunRequest) -> None:
        """Take an order. Raises Refused: a job runs, its operator has not armed, or the cell cannot do it."""
        names, asked = tuple(self._description.objects), request.specification
        if asked.needs_object and asked.object not in names:
            raise Refused(f"the cell has no object {asked.object!r}; it has {', '.join(names)}")
        if request.faults and not self._description.simulated:
            raise Refused("only a simulated cell has scripted faults")
        if reason := self._description.refusal(asked):
            raise Refused(reason)
        try:
            if request.kind in (JobKind.DEMONSTRATION, JobKind.TRIAL):
                check_two_arms(self._description, f"a {request.kind} of a grab")
            if isinstance(asked, MoveSpecification) and asked.motion is not HandMotion.START:
                check_two_arms(self._description, f"the motion {asked.title!r}")
        except TrialError as error:
            raise Refused(str(error)) from None
        if reason := self._first_use.refusal():
            raise Refused(reason)
        with self._lock:
            self._check_free()
            number = 1 if self._job is None else self._job.number + 1
            self.authority.begin(request.operator, f"{request.kind} {number}: {request.title}", asked.by_hand)
            self._order = request
            recorded = getattr(asked, "recorded", False)
            self._job = Job(number, request.kind, JobState.STARTING, request.title, 0.0, time.time(), recorded=recorded)
            self._news.set()

    def recover(self, operator: str) -> "Future[None]":
        """Ask the loop's thread for a recovery. Raises Refused while a job runs, and unless there is a fault."""
        with self._lock:
            self._check_free()
            self.authority.recover(operator)
            self._recovery = Future()
            self._news.set()
            return self._recovery

    def status(self) -> Status:
        """Return how things are now."""
        # outside of the lock: the authority may wait for the disk, the loop for the lock
        authority, compiling = self.authority.view(), self._first_use.refusal()
        with self._lock:
            stopping = self._mailbox.stop_requested
            job = self._job
            if job is not None and job.state is JobState.RUNNING and stopping:
                job = replace(job, state=JobState.STOPPING)
            return like(
                Status,
                authority,
                cell=self._description.name,
                kind=self._source.kind,
                cell_file=str(self._source.file),
                logs=str(self._logs),
                simulated=self._description.simulated,
                objects=tuple(self._description.objects),
                object=self._object,
                job=job,
                refusal=self._refusal() or compiling or authority.refusal,
                stop_requested=stopping,
                scheduler=scheduling(os.getpid())[0],  # the loop's thread is the main one
            )

    # -- the loop's side

    @property
    def has_news(self) -> bool:
        """Whether the loop's thread has something to do: an order, a recovery, the end."""
        return self._news.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for news, at most `timeout_s`. Only without a cell: with one, the robot is the clock."""
        self._news.wait(timeout_s)

    def collect(self) -> tuple[RunRequest | None, "Future[None] | None"]:
        """Return what is to be done, and forget it."""
        with self._lock:
            order, self._order = self._order, None
            recovery, self._recovery = self._recovery, None
            if self._ending is None:
                self._news.clear()
            return order, recovery

    def refused(self, reason: str) -> None:
        """Note that an idle arm refuses to move: a fault, unless the recovery from it has been asked for already."""
        with self._lock:
            if self._recovery is None:
                self.authority.fault(reason)

    def opened(self, object_name: str) -> None:
        """Note that a cell with this object answers."""
        with self._lock:
            self._object = object_name

    @property
    def object_name(self) -> str:
        """What the open cell holds."""
        return self._object

    @property
    def job_number(self) -> int:
        """Number of the newest job, 0 before the first one."""
        return 0 if self._job is None else self._job.number

    def started(self, log: str | None, cameras: Mapping[str, str] = {}) -> None:
        """Note that the job runs and which log it writes, None where it writes none. cameras: see Job."""
        self._change(state=JobState.RUNNING, log=log, cameras=dict(cameras))

    def progress(self, fraction: float) -> None:
        """Note how far the job is, from 0 to 1."""
        self._change(progress=min(1.0, max(0.0, float(fraction))))

    def finished(self, state: JobState, reason: str | None, success: bool | None, log: str | None) -> None:
        """Note how the job ended; both arms are at rest."""
        self.authority.end()
        progress = 1.0 if state is JobState.DONE else (self._job.progress if self._job else 0.0)
        self._change(state=state, reason=reason, success=success, log=log, progress=progress, cameras={})

    def end(self, end: End, detail: str) -> None:
        """Tell the loop's thread to come to its end, and why; a running job is stopped in a controlled way."""
        level = Level.WARNING if end is End.STOP_REQUESTED else Level.ERROR
        # before the mailbox: the loop asks watchdogs first
        self._ending = self._ending or WatchdogTrip(end, detail, level)
        self._mailbox.request_stop()
        self._news.set()

    def trip(self) -> WatchdogTrip | None:
        return self._ending

    @property
    def ending(self) -> bool:
        """Whether the end was asked for."""
        return self._ending is not None

    def _check_free(self) -> None:
        if (refusal := self._refusal()) is not None:
            raise Refused(refusal)

    def _refusal(self) -> str | None:
        if self._ending is not None:
            return "the stack is being shut down"
        if self._job is not None and self._job.active:
            return f"{self._job.kind} {self._job.number} is running: wait or stop it"
        return None

    def _change(self, **changes: object) -> None:
        with self._lock:
            if self._job is not None:
                self._job = replace(self._job, **changes)  # type: ignore[arg-type]
