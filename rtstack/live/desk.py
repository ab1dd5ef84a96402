"""The desk: what was ordered, what is being done, what went wrong. Shared by the loop's thread and the socket's.

Every method holds the lock for a few assignments only, so that the loop's thread never waits for a socket.
"""

import threading
import time
from concurrent.futures import Future
from dataclasses import replace

from rtstack.live.protocol import (
    Job,
    JobKind,
    JobRequest,
    JobState,
    RecoverRequest,
    Status,
    TrialRequest,
)
from rtstack.live.source import CellSource
from rtstack.loop.mailbox import Mailbox


class Refused(Exception):
    """The order cannot be taken now. The message is one line that says why."""


class Desk:
    """Takes one order at a time, and tells how it goes."""

    def __init__(self, source: CellSource, mailbox: Mailbox) -> None:
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._mailbox = mailbox
        self._order: JobRequest | None = None
        self._recovery: Future[None] | None = None
        self._job: Job | None = None
        self._description = source.description
        self._object = next(iter(source.description.objects))
        self._last_error: str | None = None
        self._connected = False
        self._ending = False

    # -- the socket's side

    def take(self, request: JobRequest) -> None:
        """Take an order. Raises Refused while another one holds the robot, or when the cell has no such object."""
        names = tuple(self._description.objects)
        if request.object not in names:
            raise Refused(f"the cell has no object {request.object!r}; it has {', '.join(names)}")
        with self._lock:
            refusal = self._refusal()
            if refusal is not None:
                raise Refused(refusal)
            self._mailbox.clear_stop()
            self._order = request
            self._last_error = None
            number = 1 if self._job is None else self._job.number + 1
            self._job = Job(number, JobKind(request.verb), JobState.STARTING, _title(request), 0.0, time.time())
            self._news.set()

    def stop(self) -> None:
        """Ask for a controlled stop of whatever runs; the loop sees it at its next tick."""
        self._mailbox.request_stop()

    def recover(self, _: RecoverRequest) -> "Future[None]":
        """Ask the loop's thread for a recovery between jobs. Raises Refused while a job holds the robot."""
        with self._lock:
            if self._job is not None and self._job.active:
                raise Refused("a job is running; stop it first")
            if self._recovery is None:
                self._recovery = Future()
            self._news.set()
            return self._recovery

    def status(self) -> Status:
        """Return how things are now."""
        with self._lock:
            stopping = self._mailbox.stop_requested
            job = self._job
            if job is not None and job.state is JobState.RUNNING and stopping:
                job = replace(job, state=JobState.STOPPING)
            return Status(
                cell=self._description.name,
                simulated=self._description.simulated,
                objects=tuple(self._description.objects),
                object=self._object,
                job=job,
                refusal=self._refusal(),
                last_error=self._last_error,
                stop_requested=stopping,
            )

    # -- the loop's side

    @property
    def has_news(self) -> bool:
        """Whether the loop's thread has something to do: an order, a recovery, the end."""
        return self._news.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for news, at most `timeout_s`. Only without a cell: with one, the robot is the clock."""
        self._news.wait(timeout_s)

    def collect(self) -> tuple[JobRequest | None, "Future[None] | None"]:
        """Return what is to be done, and forget it."""
        with self._lock:
            order, self._order = self._order, None
            recovery, self._recovery = self._recovery, None
            if not self._ending:
                self._news.clear()
            return order, recovery

    def opened(self, object_name: str) -> None:
        """Note that a cell with this object answers."""
        with self._lock:
            self._object = object_name
            self._connected = True

    def lost(self, reason: str) -> None:
        """Note that the cell does not answer any more, or never did."""
        with self._lock:
            self._last_error = reason
            self._connected = False

    def complain(self, reason: str | None) -> None:
        """Note what the hardware said, None once it is cleared."""
        with self._lock:
            self._last_error = reason

    def started(self, log: str) -> None:
        """Note that the job runs and which log it writes."""
        self._change(state=JobState.RUNNING, log=log)

    def progress(self, fraction: float) -> None:
        """Note how far the job is, from 0 to 1."""
        self._change(progress=min(1.0, max(0.0, float(fraction))))

    def finished(self, state: JobState, reason: str | None, success: bool | None, log: str | None) -> None:
        """Note how the job ended."""
        progress = 1.0 if state is JobState.DONE else (self._job.progress if self._job else 0.0)
        self._change(state=state, reason=reason, success=success, log=log, progress=progress)

    def end(self) -> None:
        """Tell the loop's thread to come to its end; a running job is stopped in a controlled way."""
        self._mailbox.request_stop()
        self._ending = True
        self._news.set()

    @property
    def ending(self) -> bool:
        """Whether the end was asked for."""
        return self._ending

    def _refusal(self) -> str | None:
        if self._ending:
            return "the stack is being shut down"
        if self._job is not None and self._job.active:
            return f"{self._job.kind} {self._job.number} is running; wait for it or stop it"
        return None

    def _change(self, **changes: object) -> None:
        with self._lock:
            if self._job is not None:
                self._job = replace(self._job, **changes)  # type: ignore[arg-type]


def _title(request: JobRequest) -> str:
    if isinstance(request, TrialRequest):
        return f"{request.controller}, {request.object}, {request.displacement_mm:+g} mm, seed {request.seed}"
    return f"{request.object}, variation {request.variation}, seed {request.seed}"
