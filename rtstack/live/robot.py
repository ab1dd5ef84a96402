"""The robot process: owns the cell, the loop and the live rings; carries out one job at a time.

    python -m rtstack.live.robot --run FOLDER --name NAME --logs DIR --cell TOML --kind KIND

It names no robot: the cell comes from a factory of a composition root (rtstack.live.source). It ends on SIGTERM, and
when its standard input closes, so that it never outlives its supervisor.
"""

import argparse
import contextlib
import ctypes
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from hal.cell import Cell
from hal.configuration import ConfigurationError
from hal.displacement import Displacement
from hal.errors import HardwareError, ObjectOutOfReach, RecoveryRefused, UnknownObject
from hal.realtime import beside_realtime
from hal.state import ARM_STATE
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.live.client import SOCKET_NAME
from rtstack.live.idle import IdleView
from rtstack.live.job_manager import JobManager
from rtstack.live.notify import Notifier, Pulse
from rtstack.live.parent_watch import watch_parent
from rtstack.live.protocol import (
    DemonstrationRequest,
    JobRequest,
    JobState,
    MoveRequest,
    PlaybackRequest,
    TeleoperationRequest,
    TrialRequest,
)
from rtstack.live.service import Service
from rtstack.live.source import CellSource, live_source
from rtstack.live.standalone import claim, publish_rings, withdraw_rings
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox, MailboxError
from rtstack.loop.watchdogs import CONSOLE_S, OPERATOR_S, Heartbeat
from rtstack.playback.finish import Finish
from rtstack.playback.run import NO_OBJECT, prepare_playback, run_playback, way_to_start
from rtstack.references.spreading import ExtendedReference
from rtstack.safety.judge import Cause
from rtstack.samples import ARM_SAMPLE, SIDES, Level
from rtstack.trials.assembly import safety_judges
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.followed import Followed
from rtstack.trials.move import prepare_move, run_move
from rtstack.trials.record import open_log
from rtstack.trials.result import MoveResult, PlaybackResult, Result
from rtstack.trials.run_context import RunContext
from rtstack.trials.run_observer import RunEvent
from rtstack.trials.specification import DemonstrationSpecification, Specification, TeleoperationSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.trial import prepare_trial, run_trial

_libc = ctypes.CDLL(None)
_RETRY_S = 2.0  # between two attempts to open a cell that was lost
# what the supervisor says by a signal, and what a session that runs then ends with
_ENDS: dict[int, tuple[End, str]] = {
    signal.SIGTERM: (End.STOP_REQUESTED, "the stack is being shut down"),
    signal.SIGHUP: (End.CONSOLE_GONE, "its process has died"),
}
_NOT_PLACED = (UnknownObject, ObjectOutOfReach)  # refused before anything moves


class Robot:
    """The main thread: idles, runs jobs, recovers. It is the RunObserver of its runs."""

    def __init__(
        self,
        source: CellSource,
        job_manager: JobManager,
        rings: Rings,
        mailbox: Mailbox,
        logs: Path,
        pulse: Pulse | None = None,
    ) -> None:
        self._source = source
        self._job_manager = job_manager
        self._rings = rings
        self._mailbox = mailbox
        self._logs = logs
        self._cell: Cell | None = None
        self._idle = IdleView(rings)
        self._first_object = next(iter(source.description.objects))
        self._end: End | None = None  # of the last session
        self._pulse = pulse or Pulse(Notifier())
        self._watchdogs = (
            job_manager,
            self._pulse,
            Heartbeat(lambda: mailbox.console_beat_ns, CONSOLE_S, End.CONSOLE_GONE),
            Heartbeat(lambda: mailbox.operator_beat_ns, OPERATOR_S, End.OPERATOR_GONE),
        )

    def run(self) -> None:
        """Work until the job_manager says that it ends; leave both arms stopped."""
        self._open(self._first_object, Displacement(), 0)
        try:
            while not self._job_manager.ending:
                self._watch()
                order, recovery = self._job_manager.collect()
                if recovery is not None:
                    self._recover(recovery)
                if order is not None and not self._job_manager.ending:
                    self._carry_out(order)
        finally:
            self._close()

    def run_events(self) -> Iterable[RunEvent]:
        """See RunObserver."""
        self._pulse.beat()
        return self._job_manager.authority.run_events()

    def ended(self, end: End, detail: str) -> None:
        """See RunObserver. A requested stop is no fault, nor is a grab that did not succeed."""
        self._end = end
        if end.is_fault:  # an operator must look
            self._job_manager.authority.fault(f"{end}: {detail}" if detail else str(end))

    def _watch(self) -> None:
        if self._cell is None:
            self._job_manager.wait(_RETRY_S)
            self._idle.publish(self.run_events())
            if not self._job_manager.has_news:
                self._reopen()
            return
        try:
            self._idle.watch(self._cell, lambda: self._job_manager.has_news, self._job_manager.refused, self.run_events)
        except HardwareError as error:
            self._close()
            self._job_manager.authority.fault(str(error))

    def _reopen(self) -> None:
        """Try again to reach a cell that was lost: it is read and shown, and the fault stays until it is recovered."""
        with contextlib.suppress(HardwareError):
            self._open_or_raise(self._first_object, Displacement(), 0)
            self._idle.tell(Level.INFO, "the cell answers again")

    def _recover(self, recovery: "Future[None]") -> None:
        authority = self._job_manager.authority
        try:
            cell = self._cell or self._open_or_raise(self._first_object, Displacement(), 0)
            cell.recover()
            self._look_for_causes(cell)
        except HardwareError as error:
            reason = str(error)
            if (
                self._source.kind.partition(":")[0] == "direct" and self._cell is not None
            ):  # these arms cannot be moved by hand
                self._close()
                self._open(self._first_object, Displacement(), 0)
                reason += "; the simulated cell was set up anew: recover once more"
            authority.not_recovered(reason)
            recovery.set_exception(RecoveryRefused(reason))
        else:
            authority.recovered()
            recovery.set_result(None)

    def _look_for_causes(self, cell: Cell) -> None:
        """Ask the judges whether they would let the arms be where they are. Raises HardwareError."""
        judges = safety_judges(self._source.description)
        for side, arm, judge in zip(SIDES, (cell.left, cell.right), judges, strict=True):
            sample = np.zeros(1, ARM_SAMPLE)
            state = arm.read().record
            for name in ARM_STATE.names or ():
                sample[name] = state[name]
            reason = judge.recover(sample)
            if reason is not Cause.NONE:
                raise RecoveryRefused(
                    f"{side} arm: {reason.text}: the cause persists; end the stack, and move the arm out of "
                    "it by hand: `rtstack guide`"
                )

    def _carry_out(self, order: JobRequest) -> None:
        log = _free_name(self._logs, order)
        self._end = None
        try:
            result = self._job(order, log)
        except (TrialError, LogError, *_NOT_PLACED) as error:
            self._failed(order, str(error), log)
        except HardwareError as error:
            self._job_manager.authority.fault(str(error))
            self._failed(order, str(error), log)
        except Exception as error:  # a defect of ours ends the job, not the stack: both arms are stopped by then
            traceback.print_exc()
            self._job_manager.authority.fault(f"internal error: {error}")
            self._failed(order, f"internal error, see the terminal: {error}", log)
        else:
            reason = result.failure_reason
            state = JobState.STOPPED if self._end is End.STOP_REQUESTED else JobState.DONE
            if _is_practice(order) and self._end is not None and not self._end.is_fault:
                log.unlink(missing_ok=True)  # what was not meant to be recorded; a fault's evidence stays
            self._job_manager.finished(state, reason, result.success, _name_if_there(log))
            level = Level.INFO if result.success else Level.WARNING
            self._idle.tell(level, f"{order.verb} {state}: {reason or 'success'}")
        if self._cell is None and not self._job_manager.ending:
            self._open(self._first_object, Displacement(), 0)

    def _failed(self, order: JobRequest, reason: str, log: Path) -> None:
        stopped = self._mailbox.stop_requested
        self._job_manager.finished(JobState.STOPPED if stopped else JobState.FAILED, reason, None, _name_if_there(log))
        self._idle.tell(Level.ERROR, f"{order.verb} failed: {reason}")

    def _job(self, order: JobRequest, log: Path) -> Result:
        """Read the reference, put the object in its place, run. What is refused is refused before an arm moves."""
        if isinstance(order, PlaybackRequest):
            return self._playback(order, log)
        if isinstance(order, MoveRequest):
            return self._move(order, log)
        description = self._source.description
        prepared = prepare_trial(order.specification(), description) if isinstance(order, TrialRequest) else None
        displacement = order.specification().displacement if isinstance(order, TrialRequest) else Displacement()
        self._close()
        faults = order.faults if isinstance(order, DemonstrationRequest) else ""
        cell = self._open_or_raise(order.object, displacement, order.seed, faults)
        if prepared is not None and (bias := check_estimate(cell, description, prepared.parameters.detector)):
            self._idle.tell(Level.WARNING, bias)
        start = None if prepared is None else prepared.reference.ante[:, 0]
        way = None if _is_practice(order) else start_motion(cell, description, order.object, displacement, start)
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        followed = None if prepared is None else Followed(Path(prepared.specification.reference))
        reference = prepared.reference if prepared is not None else None
        by_hand = isinstance(order, TeleoperationRequest)
        specification = order.specification(self._job_manager.job_number) if by_hand else order.specification()
        if prepared is not None:
            specification = prepared.specification
        context = self._begin(order, log, specification, cell, reference=reference, followed=followed)
        if prepared is not None:
            return run_trial(prepared, cell, context, way=way)
        if isinstance(specification, TeleoperationSpecification):
            return run_teleoperation(specification, description, cell, self._mailbox, context, way=way)
        assert isinstance(specification, DemonstrationSpecification)
        return run_demonstration(specification, description, cell, context, way=way)

    def _playback(self, order: PlaybackRequest, log: Path) -> PlaybackResult:
        """Read the log, open a cell without an object, play."""
        description = self._source.description
        prepared = prepare_playback(order.specification(), description)
        self._close()
        cell = self._open_or_raise(NO_OBJECT, Displacement(), order.seed)
        way = way_to_start(prepared, cell)
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        context = self._begin(order, log, prepared.specification, cell)
        finish = Finish(self._mailbox, self._job_manager.job_number)
        return run_playback(prepared, cell, context, soft_stop=finish, way=way)

    def _move(self, order: MoveRequest, log: Path) -> MoveResult:
        """Move the arms of the cell that is open, with what they hold."""
        description = self._source.description
        cell = self._cell or self._open_or_raise(self._first_object, Displacement(), 0)
        specification = order.specification(self._job_manager.object_name)
        prepared = prepare_move(specification, description, cell)
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        return run_move(prepared, cell, self._begin(order, log, specification, cell))

    def _begin(
        self, order: JobRequest, log: Path, specification: Specification, cell: Cell,
        reference: ExtendedReference | None = None, followed: Followed | None = None,
    ) -> RunContext:  # fmt: skip
        """Begin the log of a job, say so, and return what accompanies its run."""
        opened = open_log(
            log, specification, self._source.description, cell.name, self._source.file, reference=reference,
            followed=followed, cell=cell,
        )  # fmt: skip
        self._job_manager.started(log.name)
        self._idle.tell(Level.INFO, f"{order.verb} started: {log.name}")
        return RunContext(
            opened, self._rings, self._mailbox, self._job_manager.progress, self._watchdogs, run_observer=self
        )

    def _open(self, object_name: str, displacement: Displacement, seed: int) -> None:
        try:
            self._open_or_raise(object_name, displacement, seed)
        except HardwareError as error:
            self._job_manager.authority.fault(str(error))

    def _open_or_raise(self, object_name: str, displacement: Displacement, seed: int, faults: str = "") -> Cell:
        """faults: the text of a faults file."""
        with _script(faults) if faults else contextlib.nullcontext() as path:
            self._cell = self._source.open_cell(object_name, displacement, seed, path)
        self._job_manager.opened(object_name)
        return self._cell

    def _close(self) -> None:
        if self._cell is not None:
            self._cell.close()
            self._cell = None
            # what cell after cell leaves behind in pieces is locked memory: let go of it, while nothing moves
            _libc.malloc_trim(0)


@contextlib.contextmanager
def _script(faults: str) -> Iterator[Path]:
    """Give a faults file with this text, for the time in which a cell is opened."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as script:
        script.write(faults)
        script.flush()
        yield Path(script.name)


def _is_practice(order: JobRequest) -> bool:
    """Whether the arms are moved by hand and nothing is to be kept of it: it begins where the arms are."""
    return isinstance(order, TeleoperationRequest) and not order.recorded


def _free_name(logs: Path, order: JobRequest) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S")
    match order:
        case TrialRequest():
            what = f"trial-{order.controller}"
        case TeleoperationRequest(recorded=True):
            what = "recording"
        case MoveRequest():
            what = f"move-{order.motion.replace('_', '-')}"
        case _:
            what = order.verb
    stem = f"{stamp}-{what}" if isinstance(order, PlaybackRequest | MoveRequest) else f"{stamp}-{what}-{order.object}"
    path = logs / f"{stem}.mcap"
    number = 2
    while path.exists():
        path = logs / f"{stem}-{number}.mcap"
        number += 1
    return path


def _end_by_signal(job_manager: JobManager) -> None:
    """Have the job_manager end by the signals of the supervisor, in their order: the first says why."""
    told: SimpleQueue[int] = SimpleQueue()

    def pass_on() -> None:
        beside_realtime()
        while True:
            job_manager.end(*_ENDS[told.get()])

    # in a thread: a signal may come while the main thread holds one of the job manager's locks
    threading.Thread(target=pass_on, daemon=True, name="signals").start()
    for number in _ENDS:
        signal.signal(number, lambda number, _: told.put(number))


def _name_if_there(log: Path) -> str | None:
    return log.name if log.exists() else None


def main(arguments: list[str] | None = None) -> int:
    """Run the robot process. Returns its exit status: 0 after a normal end, 2 for what cannot work."""
    parser = argparse.ArgumentParser(prog="rtstack.live.robot")
    parser.add_argument("--run", type=Path, required=True, help="folder of the socket")
    parser.add_argument("--name", required=True, help="name of the shared memory")
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--cell", type=Path, required=True, help="cell description")
    parser.add_argument("--kind", default="direct", help="kind of cell, as the command line spells it")
    parser.add_argument("--alone", action="store_true", help="without a supervisor: a service of its own")
    asked = parser.parse_args(arguments)
    try:
        if asked.alone:
            claim(asked.run, asked.name)
        source = live_source(asked.cell, asked.kind)
        asked.logs.mkdir(parents=True, exist_ok=True)
        audit = AuditTrail(asked.logs / FILE_NAME)
        mailbox = Mailbox.create(f"{asked.name}-mailbox")
    except (ConfigurationError, MailboxError, LogError, TrialError, OSError) as error:
        print(f"robot process: {error}", file=sys.stderr)
        return 2
    job_manager = JobManager(source, mailbox, audit)
    _end_by_signal(job_manager)
    if not asked.alone:
        watch_parent(lambda: job_manager.end(End.PARENT_GONE, "the supervisor has died"))
    rings = Rings.create()
    notifier = Notifier()
    pulse = Pulse(notifier)
    try:
        service = Service(job_manager, asked.run / SOCKET_NAME, pulse)
        try:
            if asked.alone:
                publish_rings(asked.run, rings.name)
            else:
                print(rings.name, flush=True)  # the supervisor waits for this line
            Robot(source, job_manager, rings, mailbox, asked.logs, pulse).run()
        finally:
            service.close()
    finally:
        notifier.close()
        if asked.alone:
            withdraw_rings(asked.run)
        rings.close()
        mailbox.close()
        audit.close()
        with contextlib.suppress(OSError):  # the supervisor's, but it may have been killed
            asked.run.rmdir()
    return 0


if __name__ == "__main__":
    sys.exit(main())
