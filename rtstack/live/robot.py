"""The robot process: owns the cell, the loop and the live rings; carries out one job at a time.

    python -m rtstack.live.robot --run FOLDER --name NAME --logs DIR --cell TOML --kind KIND

It ends on SIGTERM, and when its standard input closes, so that it never outlives its supervisor.
"""

import contextlib
import os
import signal
import socket
import socketserver
import sys
import threading
import traceback
from collections.abc import Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as RecoveryTimeout
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from hal.base.configuration import ConfigurationError
from hal.base.realtime import beside_realtime
from hal.base.shared import held, remove_left
from hal.cell import Cell
from hal.errors import HardwareError, ObjectOutOfReach, RecoveryRefused, UnknownObject
from hal.extensions import ExtensionError, culprit, raised
from hal.state import ARM_STATE
from rtstack.control.parameters import DetectorParameters
from rtstack.live import protocol
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.live.client import SOCKET_NAME, peer_uid
from rtstack.live.idle import IdleView
from rtstack.live.job_manager import JobManager
from rtstack.live.jobs import Jobs
from rtstack.live.notify import Notifier, Pulse
from rtstack.live.parent_watch import watch_parent
from rtstack.live.source import CellSource, live_source
from rtstack.live.standalone import RINGS, claim, process_arguments
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import CONSOLE_S, OPERATOR_S, Heartbeat
from rtstack.safety.arming import Refused
from rtstack.safety.judge import Cause
from rtstack.samples import ARM_SAMPLE, Level
from rtstack.trials.assembly import safety_judges
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.record import free_name
from rtstack.trials.run_context import RunEvent

# The limit holds for both arms at once: a real one takes 0.7 to more than 12 s (GitHub, franka_ros issues 317 and 308)
_RECOVERY_TIMEOUT_S = 30.0
_MOST_CONNECTIONS = 64  # a thread each; a console has four
_WATCH_S = 0.05  # period of the calls to the control authority


class Service:
    """Serves a job manager at a Unix-domain socket that only this user can open: threads that never touch an arm.

    It calls the control authority regularly, so that a lease ends without a request. Its threads have raised priority.
    """

    def __init__(self, job_manager: JobManager, path: Path, pulse: Pulse | None = None) -> None:
        self._path = path
        mask = os.umask(0o177)  # the socket is ours alone from the first moment on
        try:
            self._server = _Server(str(path), _Handler)
        finally:
            os.umask(mask)
        self._server.job_manager, self._server.pulse = job_manager, pulse
        threading.Thread(target=self._serve, daemon=True, name="service").start()

    def _serve(self) -> None:
        beside_realtime()
        self._server.serve_forever(_WATCH_S)

    def close(self) -> None:
        """Stop serving and remove the socket."""
        self._server.shutdown()
        self._server.server_close()
        self._path.unlink(missing_ok=True)


class _Server(socketserver.ThreadingUnixStreamServer):
    daemon_threads = True
    request_queue_size = 1024  # a full queue refuses at once
    job_manager: JobManager
    pulse: Pulse | None

    def __init__(self, *arguments: Any) -> None:
        self.waiting: dict[socket.socket, None] = {}  # connections without an open request, the longest first
        super().__init__(*arguments)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Called by serve_forever: only programs of this user, and of root, are served, and so many at a time."""
        if peer_uid(request) not in (0, os.geteuid()):
            return False
        self.waiting[request] = None
        if len(self.waiting) > _MOST_CONNECTIONS:
            longest = next(iter(self.waiting))
            del self.waiting[longest]
            with contextlib.suppress(OSError):
                longest.shutdown(socket.SHUT_RDWR)  # its thread ends
        return True

    def service_actions(self) -> None:
        """Called by serve_forever about once in _WATCH_S, whatever is asked."""
        self.job_manager.authority.watch()
        if self.pulse is not None:
            self.pulse.look()


class _Handler(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        beside_realtime()
        assert isinstance(self.server, _Server)
        with contextlib.suppress(ConnectionError):
            while line := self.rfile.readline(protocol.MAX_LINE_BYTES):
                self.server.waiting.pop(self.request, None)
                self.wfile.write(protocol.encode(answer(self.server.job_manager, line)))
                self.server.waiting[self.request] = None
        self.server.waiting.pop(self.request, None)


def answer(job_manager: JobManager, line: bytes) -> protocol.Answer:
    """Return the answer to the request on a line. Never raises: what is wrong becomes the answer's error."""
    try:
        _act(job_manager, protocol.decode_request(line))
        return protocol.Answer(status=job_manager.status())
    except (protocol.ProtocolError, Refused, HardwareError) as error:
        return protocol.Answer(error=str(error))
    except RecoveryTimeout:
        return protocol.Answer(error=f"no answer from the robot within {_RECOVERY_TIMEOUT_S:g} s")


def _act(job_manager: JobManager, request: protocol.Request) -> None:
    match request:
        case protocol.StatusRequest():
            pass  # it is what every answer carries
        case protocol.TakeRequest():
            job_manager.authority.take(request.operator, request.over_from)
        case protocol.NoteRequest():
            job_manager.authority.note(request.operator, request.text, request.failed)
        case protocol.ControlRequest(verb="recover"):
            job_manager.recover(request.operator).result(_RECOVERY_TIMEOUT_S)
        case protocol.ControlRequest():
            getattr(job_manager.authority, request.verb)(request.operator)
        case _:
            job_manager.order(request)


_RETRY_S = 2.0  # between two attempts to open a cell that was lost
# what the supervisor says by a signal, and what a session that runs then ends with
_ENDS: dict[int, tuple[End, str]] = {
    signal.SIGTERM: (End.STOP_REQUESTED, "the stack is being shut down"),
    signal.SIGINT: (End.STOP_REQUESTED, "the stack is being shut down"),
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
        self._source, self._job_manager, self._mailbox, self._logs = source, job_manager, mailbox, logs
        self._idle = IdleView(rings, source.description.sides)
        self._end: End | None = None  # of the last session
        self._armed = False  # when the arms were looked at last
        self._pulse = pulse or Pulse(Notifier())
        watchdogs = (
            job_manager,
            self._pulse,
            Heartbeat(lambda: mailbox.console_beat_ns, CONSOLE_S, End.CONSOLE_GONE),
            Heartbeat(lambda: mailbox.operator_beat_ns, OPERATOR_S, End.OPERATOR_GONE),
        )
        self._jobs = Jobs(source, job_manager, rings, mailbox, self._idle, watchdogs, run_observer=self)

    def run(self) -> None:
        """Work until the job_manager says that it ends; leave the arms stopped."""
        self._jobs.try_to_open()
        try:
            while not self._job_manager.ending:
                self._watch()
                order, recovery = self._job_manager.collect()
                if recovery is not None:
                    self._recover(recovery)
                if order is not None and not self._job_manager.ending:
                    self._carry_out(order)
        finally:
            self._jobs.close()

    def run_events(self) -> Iterable[RunEvent]:
        self._pulse.beat()
        return self._job_manager.authority.run_events()

    def ended(self, end: End, detail: str) -> None:
        """See RunObserver. A requested stop is no fault, nor is a grab that did not succeed."""
        self._end = end
        if end.is_fault:  # an operator must look
            self._job_manager.authority.fault(f"{end}: {detail}" if detail else str(end))

    def _watch(self) -> None:
        if self._jobs.open_cell is None:
            self._job_manager.wait(_RETRY_S)
            self._idle.publish(self.run_events())
            if not self._job_manager.has_news:  # it is read and shown, and the fault stays until it is recovered
                with contextlib.suppress(HardwareError):
                    self._jobs.open_first()
                    self._idle.tell(Level.INFO, "the cell answers again")
            return
        manager, was_armed = self._job_manager, self._armed
        armed = self._armed = manager.authority.armed
        try:
            if armed and not was_armed:
                self._look_at_estimate(self._jobs.open_cell)
            self._idle.watch(
                self._jobs.open_cell, lambda: manager.has_news or manager.authority.armed != armed, manager.refused,
                self.run_events,
            )  # fmt: skip
        except HardwareError as error:
            self._jobs.close()
            manager.authority.fault(str(error))

    def _look_at_estimate(self, cell: Cell) -> None:
        """Say what the arms feel at rest, once they are armed: what is ordered next may be a trial."""
        try:
            bias = check_estimate(cell, self._source.description, DetectorParameters())
        except TrialError as error:
            bias = f"a trial would be refused: {error}"
        if bias:
            self._idle.tell(Level.WARNING, bias)

    def _recover(self, recovery: "Future[None]") -> None:
        authority = self._job_manager.authority
        try:
            cell = self._jobs.open_cell or self._jobs.open_first()
            cell.recover()
            self._look_for_causes(cell)
        except HardwareError as error:
            reason = str(error)
            # the arms of a plant in this process cannot be moved by hand
            if self._source.kind.partition(":")[0] == "direct" and self._jobs.open_cell is not None:
                self._jobs.close()
                self._jobs.try_to_open()
                reason += "; the simulated cell was set up anew: recover once more"
            authority.not_recovered(reason)
            recovery.set_exception(RecoveryRefused(reason))
        else:
            authority.recovered()
            recovery.set_result(None)

    def _look_for_causes(self, cell: Cell) -> None:
        """Ask the judges whether they would let the arms be where they are. Raises HardwareError."""
        for side, arm, judge in zip(cell.sides, cell.arms, safety_judges(self._source.description), strict=True):
            sample, state = np.zeros(1, ARM_SAMPLE), arm.read().record
            for name in ARM_STATE.names or ():
                sample[name] = state[name]
            if (reason := judge.recover(sample)) is not Cause.NONE:
                raise RecoveryRefused(
                    f"{side} arm: {reason.text}: the cause persists; move the arm out of it by hand: hold *Guide by "
                    "hand* on the page Operate, or end the stack and use `rtstack guide`"
                )

    def _carry_out(self, order: protocol.RunRequest) -> None:
        log = self._logs / order.log if order.log else free_name(self._logs, order.specification.log_stem)
        self._end = None
        try:
            result = self._jobs.run(order, log)
        except (TrialError, LogError, ExtensionError, *_NOT_PLACED) as error:
            self._failed(order, str(error), log)
        except HardwareError as error:
            self._job_manager.authority.fault(str(error))
            self._failed(order, str(error), log)
        except Exception as error:  # a defect of ours ends the job, not the stack: the arms are stopped by then
            traceback.print_exc()
            reason = raised(error) if culprit(error) else f"internal error, see the terminal: {error}"
            self._job_manager.authority.fault(reason)
            self._failed(order, reason, log)
        else:
            reason = result.failure_reason
            state = protocol.JobState.STOPPED if self._end is End.STOP_REQUESTED else protocol.JobState.DONE
            if order.specification.practice and self._end is not None and not self._end.is_fault:
                log.unlink(missing_ok=True)  # what was not meant to be recorded; a fault's evidence stays
            self._job_manager.finished(state, reason, result.success, _name_if_there(log))
            level = Level.INFO if result.success else Level.WARNING
            self._idle.tell(level, f"{order.kind} {state}: {reason or 'success'}")
        if self._jobs.open_cell is None and not self._job_manager.ending:
            self._jobs.try_to_open()

    def _failed(self, order: protocol.RunRequest, reason: str, log: Path) -> None:
        stopped = self._mailbox.stop_requested
        self._job_manager.finished(
            protocol.JobState.STOPPED if stopped else protocol.JobState.FAILED, reason, None, _name_if_there(log)
        )
        self._idle.tell(Level.ERROR, f"{order.kind} failed: {reason}")


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
    asked = process_arguments("rtstack.live.robot").parse_args(arguments)
    with contextlib.ExitStack() as stack:
        stack.callback(remove_left)  # of a supervisor that was killed
        try:
            if asked.alone:
                claim(asked.run, asked.name)
            stack.enter_context(held(asked.run))
            source = live_source(asked.cell, asked.kind)
            asked.logs.mkdir(parents=True, exist_ok=True)
            audit = AuditTrail(asked.logs / FILE_NAME)
            stack.callback(audit.close)
            mailbox = Mailbox.create(f"{asked.name}-mailbox")
            stack.callback(mailbox.close)
            rings = stack.enter_context(Rings.create())
            job_manager = JobManager(source, mailbox, audit, asked.logs.resolve())
            _end_by_signal(job_manager)
            notifier = Notifier()
            stack.callback(notifier.close)
            pulse = Pulse(notifier)
            service = Service(job_manager, asked.run / SOCKET_NAME, pulse)
            stack.callback((asked.run / RINGS).unlink, missing_ok=True)
            stack.callback(service.close)
            (asked.run / RINGS).write_text(rings.name)
        except (ConfigurationError, LogError, TrialError, OSError) as error:
            print(f"robot process: {error}", file=sys.stderr)
            return 2
        if not asked.alone:
            watch_parent(lambda: job_manager.end(End.PARENT_GONE, "the supervisor has died"))
            with contextlib.suppress(BrokenPipeError):  # the supervisor waits for this line, or was killed
                os.write(sys.stdout.fileno(), b"ready\n")
        Robot(source, job_manager, rings, mailbox, asked.logs, pulse).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
