"""The robot process: owns the cell, the loop and the live rings; carries out one job at a time.

    python -m rtstack.live.robot --run FOLDER --name NAME --logs DIR --source MODULE:FUNCTION [--cell TOML]

It names no robot: the cell comes from a factory of a composition root (rtstack.live.source). It ends on SIGTERM, and
when its standard input closes, so that it never outlives its supervisor.
"""

import argparse
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.live.desk import Desk
from rtstack.live.idle import IdleView
from rtstack.live.lifeline import hold_lifeline
from rtstack.live.protocol import DemonstrationRequest, JobRequest, JobState, TrialRequest
from rtstack.live.service import Service
from rtstack.live.source import CellSource, SourceError, load_source
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox, MailboxError
from rtstack.samples import Level
from rtstack.trials.run import TrialError, run_demonstration, run_trial

_RETRY_S = 0.5  # without a cell there is no clock but ours


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

    def run(self) -> None:
        """Work until the desk says that it ends; leave both arms stopped."""
        self._open(self._source.objects[0].name, 0.0, 0)
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
            return
        try:
            self._idle.watch(self._cell, lambda: self._desk.has_news)
        except HardwareError as error:
            self._close()
            self._desk.lost(str(error))

    def _recover(self, recovery: "Future[None]") -> None:
        try:
            if self._cell is None:
                self._open_or_raise(self._source.objects[0].name, 0.0, 0)
            else:
                self._cell.left.recover()
                self._cell.right.recover()
            self._desk.complain(None)
            recovery.set_result(None)
        except HardwareError as error:
            self._desk.complain(str(error))
            recovery.set_exception(error)

    def _carry_out(self, order: JobRequest) -> None:
        displacement_m = order.displacement_mm * 1e-3 if isinstance(order, TrialRequest) else 0.0
        log = _free_name(self._logs, order)
        try:
            self._close()
            cell = self._open_or_raise(order.object, displacement_m, order.seed)
            self._desk.started(log.name)
            self._idle.tell(Level.INFO, f"{order.verb} started: {log.name}")
            success, reason = self._job(order, cell, log)
        except (HardwareError, TrialError) as error:
            self._desk.finished(JobState.FAILED, str(error), None, _name_if_there(log))
            self._idle.tell(Level.ERROR, f"{order.verb} failed: {error}")
            if isinstance(error, HardwareError):
                self._desk.complain(str(error))
            if self._cell is None:
                self._open(self._source.objects[0].name, 0.0, 0)
            return
        if self._mailbox.stop_requested:
            state, reason = JobState.STOPPED, reason or "stopped by the operator"
        else:
            state = JobState.DONE
        self._desk.finished(state, reason, success, _name_if_there(log))
        self._idle.tell(
            Level.INFO if success else Level.WARNING, f"{order.verb} {state}: {reason or 'as asked'}"
        )

    def _job(self, order: JobRequest, cell: Cell, log: Path) -> tuple[bool, str | None]:
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        progress: Callable[[float], None] = self._desk.progress
        if isinstance(order, DemonstrationRequest):
            demonstration = run_demonstration(
                order.specification(),
                cell,
                log_path=log,
                live=self._rings,
                mailbox=self._mailbox,
                progress=progress,
            )
            return demonstration.success, demonstration.failure_reason
        trial = run_trial(
            order.specification(),
            cell,
            log_path=log,
            live=self._rings,
            mailbox=self._mailbox,
            progress=progress,
        )
        return trial.success, trial.failure_reason

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


def _free_name(logs: Path, order: JobRequest) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S")
    what = f"trial-{order.controller}" if isinstance(order, TrialRequest) else "demonstration"
    path = logs / f"{stamp}-{what}-{order.object}.mcap"
    number = 2
    while path.exists():
        path = logs / f"{stamp}-{what}-{order.object}-{number}.mcap"
        number += 1
    return path


def _name_if_there(log: Path) -> str | None:
    return log.name if log.exists() else None


def main(arguments: list[str] | None = None) -> int:
    """Run the robot process. Returns its exit status: 0 after a normal end, 2 for what cannot work."""
    parser = argparse.ArgumentParser(prog="rtstack.live.robot")
    parser.add_argument("--run", type=Path, required=True, help="folder of the socket")
    parser.add_argument("--name", required=True, help="name of the shared memory")
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--source", required=True, help="module:function that gives the cell")
    parser.add_argument("--cell", type=Path, default=None, help="cell description")
    asked = parser.parse_args(arguments)
    try:
        source = load_source(asked.source, asked.cell)
        asked.logs.mkdir(parents=True, exist_ok=True)
        mailbox = Mailbox.create(f"{asked.name}-mailbox")
    except (SourceError, MailboxError, OSError) as error:
        print(f"robot process: {error}", file=sys.stderr)
        return 2
    desk = Desk(source, mailbox)
    signal.signal(signal.SIGTERM, lambda *_: desk.end())
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
    return 0


if __name__ == "__main__":
    sys.exit(main())
