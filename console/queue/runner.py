"""Orders the queue's trials one after the other, on the word of who has started it, and pauses it when in doubt.

What may move is decided in the robot process alone: an order here carries the operator's name, as a page's does.
"""

import contextlib
import threading
import time
from collections.abc import Callable

from console.queue.entry import Entry, EntryState
from console.queue.queue import Queue
from console.refused import Refused
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import Job, JobState, Phase, RunRequest, Status
from rtstack.log.errors import LogError
from rtstack.log_folder.catalogue import Catalogue
from rtstack.log_folder.log_rows import NoReference, log_row, reference_of
from rtstack.trials.specification import TrialSpecification, like

PERIOD_S = 0.1
UNSEEN = "its end was not seen: another job followed at once"
DONE = "all of it is done"


class QueueRunner:
    """The thread. client: its own, with a short patience; `learn` takes what an order's answer says."""

    def __init__(
        self, queue: Queue, client: RobotClient, catalogue: Catalogue, learn: Callable[[Status], object]
    ) -> None:
        self._queue, self._client, self._catalogue, self._learn = queue, client, catalogue, learn
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="queue")
        self._thread.start()

    def close(self) -> None:
        """End the thread; the queue is paused."""
        self._ending.set()
        self._thread.join()
        self._queue.pause("the console has ended")

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            try:
                self.step()
            except Refused as error:
                self._queue.pause(str(error))

    def step(self) -> None:
        """Look once: follow the trial that runs, or order the next one. Raises Refused."""
        queue, running = self._queue, self._queue.running()
        if queue.operator is None and running is None:
            return
        try:
            status = self._client.status()
        except (RobotUnreachable, RobotRefused) as error:
            queue.pause(str(error))
            return
        if queue.operator is not None and status.holder != queue.operator:
            queue.pause(f"{queue.operator} no longer has control")
        if running is not None:
            self._follow(running, status)
        elif queue.operator is not None:
            self._go_on(queue.operator, status)

    def _go_on(self, operator: str, status: Status) -> None:
        entry = self._queue.next()
        if entry is None:
            self._queue.pause(DONE)
        elif status.job is not None and status.job.active:
            return  # another one of this operator's: its turn comes after
        elif status.phase is not Phase.ARMED:
            self._queue.pause(status.refusal or f"the arms are {status.phase}")
        else:
            self._order(entry, operator)

    def _order(self, entry: Entry, operator: str) -> None:
        queue = self._queue
        try:
            reference = reference_of(self._catalogue, entry.trial.reference)
        except (NoReference, LogError) as error:
            queue.pause(f"{entry.followed}: {error}")
            return
        asked = like(TrialSpecification, entry.trial, reference=str(reference.path))
        if not queue.claim(entry.id, operator):
            return
        try:
            status = self._client.start(RunRequest(asked, operator))
        except RobotRefused as error:
            queue.pause(str(error))
            queue.note(entry.id, state=EntryState.WAITING, began_s=None)
        except RobotUnreachable as error:  # it may have been heard all the same: it is not ordered twice
            queue.pause(str(error))
            queue.note(entry.id, state=EntryState.STOPPED, reason=f"it is not known whether it ran: {error}")
        else:
            self._learn(status)
            queue.note(entry.id, job=None if status.job is None else status.job.number)

    def _follow(self, entry: Entry, status: Status) -> None:
        job = status.job
        if job is None or entry.job is None or job.number < entry.job:
            return
        if job.number > entry.job:
            self._queue.pause(UNSEEN)
            self._queue.note(entry.id, state=EntryState.STOPPED, reason=UNSEEN)
        elif not job.active:
            self._end(entry, job, status)

    def _end(self, entry: Entry, job: Job, status: Status) -> None:
        state = EntryState.SUCCEEDED if job.success else EntryState.FAILED
        state = EntryState.STOPPED if job.state is JobState.STOPPED else state
        reason = None if state is EntryState.SUCCEEDED else job.reason or f"the trial was {state}"
        if (pause := self._why_pause(state, reason, job, status)) is not None:
            self._queue.pause(pause)
        began_s, log = job.started_s, None
        with contextlib.suppress(LogError):
            log = next((entry for entry in self._catalogue.entries() if entry.path.name == job.log), None)
        self._queue.note(
            entry.id, state=state, reason=reason, log=None if log is None else log.id, began_s=began_s,
            duration_s=max(0.0, time.time() - began_s), ending=None if log is None else log_row(log, None).ending,
        )  # fmt: skip

    def _why_pause(self, state: EntryState, reason: str | None, job: Job, status: Status) -> str | None:
        if status.phase is Phase.FAULT:
            return f"there is a fault: {status.reason}"
        if state is EntryState.STOPPED:
            return f"a trial was stopped: {reason}"
        ran = job.state is JobState.DONE  # to its end, whatever became of the grab
        if state is EntryState.FAILED and not (ran and self._queue.past_failures):
            return f"a trial failed: {reason}"
        if not status.simulated and self._queue.next() is not None:
            return "put the object in its place for the next trial, then start again"  # no robot does
        return None
