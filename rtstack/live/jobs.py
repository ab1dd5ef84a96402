"""Carries out the jobs of the robot process, each on a cell that it opens, in the main thread."""

import contextlib
import ctypes
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from hal.cell import Cell
from hal.displacement import Displacement
from hal.errors import HardwareError
from rtstack.live.idle import IdleView
from rtstack.live.job_manager import JobManager
from rtstack.live.protocol import (
    DemonstrationRequest,
    GuideRequest,
    JobRequest,
    MoveRequest,
    PlaybackRequest,
    TeleoperationRequest,
    TrialRequest,
)
from rtstack.live.source import CellSource
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import Watchdog
from rtstack.playback.finish import Finish
from rtstack.playback.run import NO_OBJECT, prepare_playback, run_playback, way_to_start
from rtstack.references.spreading import ExtendedReference
from rtstack.samples import Level
from rtstack.teleoperation.clutch import Clutch
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.followed import Followed
from rtstack.trials.guide import run_guide
from rtstack.trials.move import prepare_move, run_move
from rtstack.trials.record import open_log
from rtstack.trials.result import Result
from rtstack.trials.run_context import RunContext
from rtstack.trials.run_observer import RunObserver
from rtstack.trials.specification import Specification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.trial import prepare_trial, run_trial

_libc = ctypes.CDLL(None)
_FIRST_HOLD_S = 3.0  # from a guide's order until its clutch must be held: the page that orders it holds it already
_LOOK_S = 0.01


class Jobs:
    """The open cell, if there is one, and the jobs on it. A job that is refused is refused before an arm moves."""

    def __init__(
        self,
        source: CellSource,
        job_manager: JobManager,
        rings: Rings,
        mailbox: Mailbox,
        idle: IdleView,
        watchdogs: tuple[Watchdog, ...],
        run_observer: RunObserver,
    ) -> None:
        self.cell: Cell | None = None
        self._source, self._description = source, source.description
        self._job_manager = job_manager
        self._rings = rings
        self._mailbox = mailbox
        self._idle = idle
        self._watchdogs = watchdogs
        self._run_observer = run_observer
        self._first_object = next(iter(source.description.objects))

    def run(self, order: JobRequest, log: Path) -> Result:
        """Carry out a job. Raises TrialError, LogError, HardwareError."""
        if not isinstance(order, GuideRequest):  # which is the way out, and to the next point of a calibration
            self._source.check()
        match order:
            case PlaybackRequest():
                return self._playback(order, log)
            case MoveRequest():
                return self._move(order, log)
            case TrialRequest():
                return self._trial(order, log)
            case TeleoperationRequest():
                return self._teleoperation(order, log)
            case DemonstrationRequest():
                return self._demonstration(order, log)
            case GuideRequest():
                return self._guide()

    def open_first(self) -> Cell:
        """Open a cell with the description's first object, to idle on. Raises HardwareError."""
        return self._open(self._first_object, Displacement(), 0)

    def try_to_open(self) -> None:
        """Open a cell to idle on; where that fails, it is a fault."""
        try:
            self.open_first()
        except HardwareError as error:
            self._job_manager.authority.fault(str(error))

    def close(self) -> None:
        """Close the open cell, if there is one."""
        if self.cell is not None:
            self.cell.close()
            self.cell = None
            # what cell after cell leaves behind in pieces is locked memory: let go of it, while nothing moves
            _libc.malloc_trim(0)

    def _trial(self, order: TrialRequest, log: Path) -> Result:
        prepared = prepare_trial(order.specification(), self._description)
        specification, reference = prepared.specification, prepared.reference
        cell = self._fresh(order.object, specification.displacement, order.seed)
        if bias := check_estimate(cell, self._description, prepared.parameters.detector):
            self._idle.tell(Level.WARNING, bias)
        way = start_motion(cell, self._description, order.object, specification.displacement, reference.ante[:, 0])
        followed = Followed(Path(specification.reference))
        return run_trial(prepared, cell, self._begin(order, log, specification, cell, reference, followed), way=way)

    def _teleoperation(self, order: TeleoperationRequest, log: Path) -> Result:
        cell = self._fresh(order.object, Displacement(), order.seed)
        way = start_motion(cell, self._description, order.object) if order.recorded else None
        specification = order.specification(self._job_manager.job_number)
        context = self._begin(order, log, specification, cell)
        return run_teleoperation(specification, self._description, cell, self._mailbox, context, way=way)

    def _demonstration(self, order: DemonstrationRequest, log: Path) -> Result:
        cell = self._fresh(order.object, Displacement(), order.seed, order.faults)
        way = start_motion(cell, self._description, order.object)
        specification = order.specification()
        context = self._begin(order, log, specification, cell)
        return run_demonstration(specification, self._description, cell, context, way=way)

    def _playback(self, order: PlaybackRequest, log: Path) -> Result:
        prepared = prepare_playback(order.specification(), self._description)
        cell = self._fresh(NO_OBJECT, Displacement(), order.seed)
        way = way_to_start(prepared, cell)
        context = self._begin(order, log, prepared.specification, cell)
        finish = Finish(self._mailbox, self._job_manager.job_number)
        return run_playback(prepared, cell, context, soft_stop=finish, way=way)

    def _move(self, order: MoveRequest, log: Path) -> Result:
        """Move the arms of the cell that is open, with what they hold."""
        cell = self.cell or self.open_first()
        specification = order.specification(self._job_manager.object_name)
        prepared = prepare_move(specification, self._description, cell)
        return run_move(prepared, cell, self._begin(order, log, specification, cell))

    def _guide(self) -> Result:
        """Let a person push the arms of the cell that is open, while the operator holds the clutch. Writes no log."""
        cell = self.cell or self.open_first()
        clutch = Clutch(self._mailbox, self._job_manager.job_number)
        self._job_manager.started(None)
        due_s = time.monotonic() + _FIRST_HOLD_S
        while not clutch.held:
            gone = any(watchdog.trip() for watchdog in self._watchdogs)
            if gone or self._mailbox.stop_requested or time.monotonic() > due_s:
                raise TrialError("the clutch was not held: nothing has moved")
            time.sleep(_LOOK_S)
        watchdogs = (*self._watchdogs, clutch)
        context = RunContext(None, self._rings, self._mailbox, None, watchdogs, self._run_observer)
        return run_guide(self._description, cell, context)

    def _begin(
        self, order: JobRequest, log: Path, specification: Specification, cell: Cell,
        reference: ExtendedReference | None = None, followed: Followed | None = None,
    ) -> RunContext:  # fmt: skip
        """Begin the log of a job, say so, and return what accompanies its run."""
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        opened = open_log(
            log, specification, self._description, cell.name, self._source.file, reference=reference,
            followed=followed, cell=cell,
        )  # fmt: skip
        self._job_manager.started(log.name, {} if opened.cameras is None else opened.cameras.rings)
        self._idle.tell(Level.INFO, f"{order.verb} started: {log.name}")
        progress = self._job_manager.progress
        return RunContext(
            opened, self._rings, self._mailbox, progress, self._watchdogs, run_observer=self._run_observer
        )

    def _fresh(self, object_name: str, displacement: Displacement, seed: int, faults: str = "") -> Cell:
        self.close()
        return self._open(object_name, displacement, seed, faults)

    def _open(self, object_name: str, displacement: Displacement, seed: int, faults: str = "") -> Cell:
        """faults: the text of a faults file."""
        with _script(faults) if faults else contextlib.nullcontext() as path:
            self.cell = self._source.open_cell(object_name, displacement, seed, path)
        self._job_manager.opened(object_name)
        return self.cell


@contextlib.contextmanager
def _script(faults: str) -> Iterator[Path]:
    """Give a faults file with this text, for the time in which a cell is opened."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as script:
        script.write(faults)
        script.flush()
        yield Path(script.name)


def is_practice(order: JobRequest) -> bool:
    """Whether the arms are moved by hand and nothing is to be kept of it: it begins where the arms are."""
    return isinstance(order, TeleoperationRequest) and not order.recorded


def free_name(logs: Path, order: JobRequest) -> Path:
    """Return where the log of a job goes: by its time and kind; an existing file is never taken."""
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
    without_object = isinstance(order, PlaybackRequest | MoveRequest | GuideRequest)
    stem = f"{stamp}-{what}" if without_object else f"{stamp}-{what}-{order.object}"
    path = logs / f"{stem}.mcap"
    number = 2
    while path.exists():
        path = logs / f"{stem}-{number}.mcap"
        number += 1
    return path
