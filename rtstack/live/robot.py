"""The robot process: owns the cell, the loop and the live rings; carries out one job at a time.

    python -m rtstack.live.robot --run FOLDER --name NAME --logs DIR --source MODULE:FUNCTION --cell TOML --kind KIND

It names no robot: the cell comes from a factory of a composition root (rtstack.live.source). It ends on SIGTERM, and
when its standard input closes, so that it never outlives its supervisor.
"""

import argparse
import contextlib
import signal
import sys
import threading
import time
import traceback
from concurrent.futures import Future
from pathlib import Path

from hal.cell import Cell
from hal.errors import HardwareError, RecoveryRefused
from rtstack.configuration import ConfigurationError
from rtstack.live.desk import Desk
from rtstack.live.idle import IdleView
from rtstack.live.lifeline import hold_lifeline
from rtstack.live.protocol import DemonstrationRequest, JobRequest, JobState, TrialRequest
from rtstack.live.service import Service
from rtstack.live.source import CellSource, SourceError, load_source
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.log.writer import Attachment
from rtstack.loop.mailbox import Mailbox, MailboxError
from rtstack.samples import Level
from rtstack.trials.errors import TrialError
from rtstack.trials.record import open_log
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.run import prepare_trial, run_demonstration, run_trial
from rtstack.trials.start_motion import start_motion

_RETRY_S = 2.0  # between two attempts to open a cell that was lost


class Robot:
    """The main thread: idles, carries out orders, recovers."""

    def __init__(self, source: CellSource, desk: Desk, rings: Rings, mailbox: Mailbox, logs: Path) -> None:
        self._source = source
        self._desk = desk
        self._rings = rings
        self._mailbox = mailbox
        self._logs = logs
        self._cell: Cell | None = None
        self._idle = IdleView(rings)
        self._first_object = next(iter(source.description.objects))

    def run(self) -> None:
        """Work until the desk says that it ends; leave both arms stopped."""
        self._open(self._first_object, 0.0, 0)
        try:
            while not self._desk.ending:
                self._watch()
                order, recovery = self._desk.collect()
                if recovery is not None:
                    self._recover(recovery)
                if order is not None and not self._desk.ending:
                    self._carry_out(order)
        finally:
            self._close()

    def _watch(self) -> None:
        if self._cell is None:
            self._desk.wait(_RETRY_S)
            if not self._desk.has_news:
                self._reopen()
            return
        try:
            self._idle.watch(self._cell, lambda: self._desk.has_news, self._desk.complain)
        except HardwareError as error:
            self._close()
            self._desk.lost(str(error))

    def _reopen(self) -> None:
        """Try again to reach a cell that was lost: it is read and shown, and nothing moves before it is ordered."""
        try:
            self._open_or_raise(self._first_object, 0.0, 0)
        except HardwareError as error:
            self._desk.complain(str(error))
        else:
            self._desk.complain(None)
            self._idle.tell(Level.INFO, "the cell answers again")

    def _recover(self, recovery: "Future[None]") -> None:
        try:
            if self._cell is None:
                self._open_or_raise(self._first_object, 0.0, 0)
            else:
                _recover_both(self._cell)
            self._desk.complain(None)
            recovery.set_result(None)
        except HardwareError as error:
            self._desk.complain(str(error))
            recovery.set_exception(error)

    def _carry_out(self, order: JobRequest) -> None:
        log = _free_name(self._logs, order)
        try:
            result = self._job(order, log)
        except (HardwareError, TrialError, LogError) as error:
            self._failed(order, str(error), log)
        except Exception as error:  # a defect of ours ends the job, not the stack: both arms are stopped by then
            traceback.print_exc()
            self._failed(order, f"internal error, see the terminal: {error}", log)
        else:
            reason = result.failure_reason
            state = JobState.STOPPED if self._mailbox.stop_requested else JobState.DONE
            self._desk.finished(state, reason, result.success, _name_if_there(log))
            level = Level.INFO if result.success else Level.WARNING
            self._idle.tell(level, f"{order.verb} {state}: {reason or 'success'}")
        if self._cell is None and not self._desk.ending:
            self._open(self._first_object, 0.0, 0)

    def _failed(self, order: JobRequest, reason: str, log: Path) -> None:
        stopped = self._mailbox.stop_requested
        self._desk.finished(JobState.STOPPED if stopped else JobState.FAILED, reason, None, _name_if_there(log))
        self._idle.tell(Level.ERROR, f"{order.verb} failed: {reason}")

    def _job(self, order: JobRequest, log: Path) -> DemonstrationResult | TrialResult:
        """Read the reference, put the object in its place, run. What is refused is refused before an arm moves."""
        description = self._source.description
        prepared = prepare_trial(order.specification(), description) if isinstance(order, TrialRequest) else None
        displacement_m = order.displacement_mm * 1e-3 if isinstance(order, TrialRequest) else 0.0
        self._close()
        cell = self._open_or_raise(order.object, displacement_m, order.seed)
        start = None if prepared is None else prepared.reference.ante[:, 0]
        way = start_motion(cell, description, order.object, displacement_m, start)
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        attachments = () if prepared is None else (_reference(Path(prepared.specification.reference)),)
        reference = prepared.reference if prepared is not None else None
        opened = open_log(
            log, order.specification(), description, cell.name, self._source.file, attachments, reference=reference
        )
        self._desk.started(log.name)
        self._idle.tell(Level.INFO, f"{order.verb} started: {log.name}")
        live, stop, progress = self._rings, self._mailbox, self._desk.progress
        if prepared is not None:
            return run_trial(prepared, cell, log=opened, live=live, stop=stop, progress=progress, way=way)
        assert isinstance(order, DemonstrationRequest)
        return run_demonstration(
            order.specification(), description, cell, log=opened, live=live, stop=stop, progress=progress, way=way
        )

    def _open(self, object_name: str, displacement_m: float, seed: int) -> None:
        try:
            self._open_or_raise(object_name, displacement_m, seed)
        except HardwareError as error:
            self._desk.lost(str(error))

    def _open_or_raise(self, object_name: str, displacement_m: float, seed: int) -> Cell:
        self._cell = self._source.open_cell(object_name, displacement_m, seed)
        self._desk.opened(object_name)
        return self._cell

    def _close(self) -> None:
        if self._cell is not None:
            self._cell.close()
            self._cell = None


def _recover_both(cell: Cell) -> None:
    """Ask both arms before saying no. Raises RecoveryRefused with what each of them says."""
    refused: list[str] = []
    for arm in (cell.left, cell.right):
        try:
            arm.recover()
        except RecoveryRefused as error:
            refused.append(str(error))
    if refused:
        raise RecoveryRefused("; ".join(refused))


def _free_name(logs: Path, order: JobRequest) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S")
    what = f"trial-{order.controller}" if isinstance(order, TrialRequest) else "demonstration"
    path = logs / f"{stamp}-{what}-{order.object}.mcap"
    number = 2
    while path.exists():
        path = logs / f"{stamp}-{what}-{order.object}-{number}.mcap"
        number += 1
    return path


def _reference(path: Path) -> Attachment:
    return Attachment("reference.mcap", "application/octet-stream", path.read_bytes())


def _name_if_there(log: Path) -> str | None:
    return log.name if log.exists() else None


def main(arguments: list[str] | None = None) -> int:
    """Run the robot process. Returns its exit status: 0 after a normal end, 2 for what cannot work."""
    parser = argparse.ArgumentParser(prog="rtstack.live.robot")
    parser.add_argument("--run", type=Path, required=True, help="folder of the socket")
    parser.add_argument("--name", required=True, help="name of the shared memory")
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--source", required=True, help="module:function that gives the cell")
    parser.add_argument("--cell", type=Path, required=True, help="cell description")
    parser.add_argument("--kind", default="direct", help="kind of cell, as the command line spells it")
    asked = parser.parse_args(arguments)
    try:
        source = load_source(asked.source, asked.cell, asked.kind)
        asked.logs.mkdir(parents=True, exist_ok=True)
        mailbox = Mailbox.create(f"{asked.name}-mailbox")
    except (SourceError, ConfigurationError, MailboxError, LogError, TrialError, OSError) as error:
        print(f"robot process: {error}", file=sys.stderr)
        return 2
    desk = Desk(source, mailbox)
    # in a thread: a signal may come while this thread holds one of the desk's locks
    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=desk.end).start())
    hold_lifeline(desk.end)
    rings = Rings.create()
    try:
        service = Service(desk, asked.run / "robot.sock")
        try:
            print(rings.name, flush=True)  # the supervisor waits for this line
            Robot(source, desk, rings, mailbox, asked.logs).run()
        finally:
            service.close()
    finally:
        rings.close()
        mailbox.close()
        with contextlib.suppress(OSError):  # the supervisor's, but it may have been killed
            asked.run.rmdir()
    return 0


if __name__ == "__main__":
    sys.exit(main())
