"""A campaign as an operator of the stack that runs: it takes control over from the person who has armed the arms.

It never arms them after a STOP: that takes the person's *Go on*, which removes the file `pause.txt` from its folder.
"""

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from hal.cell import Cell
from rtstack.cells.kinds import SIMULATED
from rtstack.cli.interrupt import Interrupt, interruptible
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import Job, JobState, RunRequest, Status
from rtstack.live.shown_cell import shown_cell
from rtstack.live.source import described_as
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.writing.job import values_of
from rtstack.safety.arming import Phase
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.result import DemonstrationResult, MoveResult, PlacementResult, Result, TrialResult
from rtstack.trials.scoring import SuccessCriterion
from rtstack.trials.start_motion import REFUSED, WayRefused

PAUSE = "pause.txt"  # in the campaign's folder: why it is paused
DISARMED = "the arms were disarmed"
_BEAT_S = 0.5  # between two signs of life: the lease is lost after 2 s
_LOOK_S = 0.1
_RESULTS: dict[str, type[Result]] = {
    "trial": TrialResult, "demonstration": DemonstrationResult, "place": PlacementResult, "move": MoveResult,
}  # fmt: skip


class StackOperator:
    """A rtstack.experiments.cell.host.CellHost: the arms of a running stack."""

    def __init__(self, socket: Path, name: str, out: Path) -> None:
        """socket: of the robot process; out: the campaign's folder. Raises TrialError, ConfigurationError."""
        self._run, self._operator, self._pause = socket.parent, f"campaign {Path(name).stem}"[:40], out / PAUSE
        self._client, self._pulse = RobotClient(socket), RobotClient(socket)
        with self._asking(), closing(RobotClient(socket)) as client:
            status = client.status()
        self.kind, self.cell_file = status.kind, Path(status.cell_file)
        self.has_person, self._logs = not status.simulated, Path(status.logs)
        if not out.is_relative_to(self._logs):
            raise TrialError(f"--out {out}: the stack writes all logs into {self._logs}; give a folder in it")
        self._description = described_as(self.cell_file, self.kind)
        self.sets_object = self.kind.partition(":")[0] in SIMULATED
        self._lost = ""  # why control is lost
        self._waited = False  # for a person to go on
        self._stop: Interrupt | None = None

    @property
    def stopped(self) -> str:
        return "stopped between two runs" if self._stop is not None and self._stop.stop_requested else self._lost

    @property
    def paused(self) -> str:
        """See CellHost. After a STOP or a disarming a person has to go on, too; arms the arms once they have."""
        try:
            reason = self._pause.read_text(encoding="utf-8")
        except OSError:
            reason = ""
        with self._asking():
            disarmed = self._client.status().phase is Phase.DISARMED
            if not reason and disarmed and self._waited:
                self._client.arm(self._operator)
            elif not reason and disarmed:
                reason = DISARMED
                self.ask(reason)
        self._waited = bool(reason)
        return f"{reason}: press Go on on the page Campaigns" if reason else ""

    def look(self, reason: str) -> None:
        if self.has_person:
            self.ask(reason)

    def ask(self, what: str) -> None:
        self._pause.write_text(what, encoding="utf-8")

    @contextmanager
    def kept_cell(self, run: PreparedRun[Any]) -> Iterator[Cell]:
        try:
            cell, rings = shown_cell(self._run, self._description.name, self._description.sides)
        except LogError as error:
            raise TrialError(str(error)) from None
        with closing(rings):
            yield cell

    def put_back(self) -> None:
        """See CellHost. The robot process keeps the cell open."""

    @contextmanager
    def watched(self) -> Iterator[None]:
        """See CellHost: take control over from the person who has armed, and give signs of life."""
        done = threading.Event()
        beats = threading.Thread(target=self._beat, args=(done,), daemon=True, name="signs of life")
        with closing(self._client), closing(self._pulse), interruptible() as self._stop:
            with self._asking():
                status = self._client.status()
                if status.holder is None or status.phase is not Phase.ARMED:
                    what = "the campaign takes over from you"
                    raise TrialError(f"take control and arm the arms on the page first: {what}")
                self._client.take(self._operator, over_from=status.holder)
                self._client.arm(self._operator)
                self._pause.unlink(missing_ok=True)
            beats.start()
            try:
                yield
            finally:
                done.set()
                beats.join()
                if not self._lost:
                    with suppress(RobotRefused, RobotUnreachable):  # it is lost by now
                        self._client.release(self._operator)  # a motion that still runs stops

    def carry_out(self, run: PreparedRun[Any], log: Path, record: Mapping[str, str] = {}) -> Any:
        if getattr(run, "criterion", None) not in (None, SuccessCriterion()):
            raise TrialError("[success] of the plan is not the default: the stack knows no other; give --cell fci:")
        name = str(log.relative_to(self._logs))
        order = RunRequest(run.specification, self._operator, log=name, campaign=dict(record), watched=True)
        with self._asking():
            self.recover()
            job = self._end_of(self._client.start(order))
        if not log.exists() or job.state is JobState.FAILED:
            reason = job.reason or f"the {job.kind} has written no log"
            raise (WayRefused if reason.startswith(REFUSED) else TrialError)(reason)
        return _result(log, _RESULTS[job.kind], job)

    def recover(self) -> None:
        with self._asking():
            if self._client.status().phase is Phase.FAULT:
                self._client.recover(self._operator)
                self._client.arm(self._operator)

    def _end_of(self, status: Status) -> Job:
        """Wait for the end of the job that was just ordered, and stop it where that is asked for."""
        number, stopping = status.job.number if status.job is not None else 0, False
        while status.job is not None and status.job.number == number and status.job.active:
            if self.stopped and not stopping:
                stopping = True
                self._client.stop(self._operator)
            time.sleep(_LOOK_S)
            status = self._client.status()
        if status.job is None or status.job.number != number:
            raise TrialError("another run has begun since: look at the cell")
        return status.job

    def _beat(self, done: threading.Event) -> None:
        while not done.wait(_BEAT_S):
            try:
                holder = self._pulse.beat(self._operator).holder
            except RobotUnreachable as error:
                self._lost = str(error)
                return
            if holder != self._operator:
                self._lost = f"{holder or 'no operator'} has control now"
                return

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """Make of what the robot process refuses what a campaign ends with."""
        try:
            yield
        except (RobotRefused, RobotUnreachable) as error:
            raise TrialError(str(error)) from None


def _result(log: Path, kind: type[Result], job: Job) -> Result:
    """Return the result in a log that a run has just written. Raises TrialError where it has none."""
    try:
        record = read_log(log).metadata.get("result", {})
    except LogError as error:
        raise TrialError(str(error)) from None
    if not record:
        raise TrialError(job.reason or f"{log.name} has no result")
    return kind(**values_of(record))
