"""The robot process's main thread on the simulated cell, in a thread of the test."""

import itertools
import os
import threading
import time
from dataclasses import replace
from pathlib import Path

from deploy import cells
from rtstack.live.audit import AuditTrail
from rtstack.live.job_manager import JobManager
from rtstack.live.robot import Robot
from rtstack.live.source import live_source
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.clock import PacedLockstep
from tests.support.console.client import wait_for

CELL = Path(cells.__file__).parent / "grab.toml"
PATIENCE_S = 120.0
_numbers = itertools.count()


class RunningRobot:
    """A robot's main thread, run in a thread of the test, the simulated cells that it opened, and who is there."""

    def __init__(self, logs: Path, **description) -> None:
        self.mailbox = Mailbox.create(f"rtstack-test-robot-{os.getpid()}-{next(_numbers)}")
        self.rings = Rings.create()
        self.opened: list[SimulatedCell] = []
        source = live_source(CELL)
        source = replace(source, open_cell=self._open, description=replace(source.description, **description))
        self.audit = AuditTrail(logs / "audit.jsonl")
        self.job_manager = JobManager(source, self.mailbox, self.audit, logs)
        self.authority = self.job_manager.authority
        self.logs = logs
        self.console_is_there = self.operator_is_there = True
        self._ended = threading.Event()
        self._context = threading.Thread(target=self._keep_context)
        self._context.start()
        self._thread = threading.Thread(target=Robot(source, self.job_manager, self.rings, self.mailbox, logs).run)
        self._thread.start()

    def _keep_context(self) -> None:
        """What the console, the holder's page and the socket's thread do."""
        while not self._ended.wait(0.05):
            self.authority.watch()
            if self.console_is_there:
                self.mailbox.console_beat(time.monotonic_ns())
            if self.operator_is_there:
                self.authority.beat("anna")

    def order(self, request) -> None:
        """Take control, arm and order."""
        self.authority.take("anna")
        self.authority.arm("anna")
        self.job_manager.order(request)

    def finished(self):
        """Wait for the end of the job and return it."""

        def ended() -> bool:
            job = self.job_manager.status().job
            return job is not None and not job.active

        wait_for(ended)
        return self.job_manager.status().job

    def events(self, job):
        """Return the events of the job's log, as who and what."""
        events = read_log(self.logs / job.log).topic("/events")
        return [(event["name"].decode(), event["text"].decode()) for event in events]

    def _open(self, object_name, displacement_m, seed, faults=None):
        self.opened.append(simulated_cell(object_name, displacement_m, seed, clock=PacedLockstep()))
        return self.opened[-1].as_cell("lockstep")

    def latest(self, side):
        """Return the newest state of an arm that was shown."""
        record = self.rings.reader(f"/{side}/arm").latest()
        return None if record is None else record[0]

    def close(self):
        """End the thread and let go of the memory."""
        self.job_manager.end(End.STOP_REQUESTED, "the test is over")
        self._thread.join(PATIENCE_S)
        self._ended.set()
        self._context.join()
        self.audit.close()
        self.rings.close()
        self.mailbox.close()
