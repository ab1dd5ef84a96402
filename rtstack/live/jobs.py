"""Carries out the jobs of the robot process, each on a cell that it opens, in the main thread."""

import ctypes
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from hal.cell import Cell
from hal.displacement import Displacement
from hal.errors import HardwareError
from rtstack.live.idle import IdleView
from rtstack.live.job_manager import JobManager
from rtstack.live.protocol import JobKind, RunRequest
from rtstack.live.source import CellSource
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import Watchdog
from rtstack.model.cell_description import CellDescription
from rtstack.playback.run import prepare_playback
from rtstack.playback.source import Finish
from rtstack.samples import Level
from rtstack.teleoperation.source import Clutch
from rtstack.trials.carry_out import PreparedRun, carry_out
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedGuide, PreparedMove
from rtstack.trials.placement import prepare_placement
from rtstack.trials.record import TrialLog
from rtstack.trials.result import Result
from rtstack.trials.run_context import RunContext, RunObserver
from rtstack.trials.specification import Specification
from rtstack.trials.teleoperation import prepare_teleoperation
from rtstack.trials.trial import prepare_trial

# the kinds of run that the robot process carries out, each with what prepares it from its specification
_KINDS: dict[str, Callable[[Any, CellDescription], PreparedRun]] = {
    "trial": prepare_trial,
    "demonstration": prepare_demonstration,
    "teleoperation": prepare_teleoperation,
    "playback": prepare_playback,
    "move": PreparedMove,
    "place": prepare_placement,
    "guide": PreparedGuide,
}


def prepare(specification: Specification, description: CellDescription) -> PreparedRun:
    """Read and check what a run needs, before anything is opened or written. Raises TrialError with one line."""
    return _KINDS[specification.verb](specification, description)


_libc = ctypes.CDLL(None)
_FIRST_HOLD_S = 3.0  # from a guide's order until its clutch must be held: the page that orders it holds it already
_HOLD_S = 30.0  # and from another order for real arms: a person takes the key
_LOOK_S = 0.01


class Jobs:
    """The open cell, if there is one, and the host of its jobs. One that is refused is refused before an arm moves."""

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
        self.open_cell: Cell | None = None
        self._source, self._description = source, source.description
        self._job_manager, self._rings, self._mailbox, self._idle = job_manager, rings, mailbox, idle
        self._watchdogs, self._run_observer = watchdogs, run_observer
        # what the running job was ordered with: log, text of a faults file, record of a campaign, operator
        self._path, self._faults, self._campaign, self._watched, self._operator = Path(), "", None, False, ""

    def run(self, request: RunRequest, log: Path) -> Result:
        """Carry out a job. Raises TrialError, LogError, HardwareError."""
        manager, asked = self._job_manager, request.specification
        if not asked.by_hand:  # which is the way out, and to the next point of a calibration
            self._source.check()
        self._path, self._faults, self._watched = log, request.faults, request.watched
        self._campaign, self._operator = request.campaign or None, request.operator
        specification = asked.as_job(manager.job_number, request.operator, manager.object_name)
        return carry_out(prepare(specification, self._description), self)

    def open_first(self) -> Cell:
        """Open a cell with the description's first object, to idle on. Raises HardwareError."""
        return self._open(next(iter(self._description.objects)), Displacement(), 0)

    def try_to_open(self) -> None:
        """Open a cell to idle on; where that fails, it is a fault."""
        try:
            self.open_first()
        except HardwareError as error:
            self._job_manager.authority.fault(str(error))

    def close(self) -> None:
        """Close the open cell, if there is one."""
        if self.open_cell is not None:
            self.open_cell.close()
            self.open_cell = None
            # what cell after cell leaves behind in pieces is locked memory: let go of it, while nothing moves
            _libc.malloc_trim(0)

    @contextmanager
    def cell(self, run: PreparedRun) -> Iterator[Cell]:
        if run.keeps_open_cell:
            yield self.open_cell or self.open_first()
        else:
            self.close()
            yield self._open(run.specification.object, run.displacement, run.specification.seed, self._faults)

    def _open(self, object_name: str, displacement: Displacement, seed: int, faults: str = "") -> Cell:
        with _script(faults) if faults else nullcontext() as path:
            self.open_cell = cell = self._source.open_cell(object_name, displacement, seed, path)
        self._job_manager.opened(object_name)
        return cell

    def warn(self, text: str) -> None:
        self._idle.tell(Level.WARNING, text)

    def announce(self, text: str) -> None:
        """See Host: the page makes the sound of events of this name."""
        self._idle.tell(Level.WARNING, text, "countdown")

    @contextmanager
    def accompany(self, run: PreparedRun, cell: Cell) -> Iterator[RunContext]:
        """See Host. Raises TrialError where a clutch is not held."""
        manager, mailbox, watchdogs = self._job_manager, self._mailbox, self._watchdogs
        by_hand, led = run.specification.by_hand, JobKind(run.specification.verb) is JobKind.TELEOPERATION
        # a campaign has a person who watches, and a teleoperation its own clutch
        if by_hand or not (run.description.simulated or led or self._watched or run.shadow):
            manager.started(None)
            watchdogs = (*watchdogs, self._held_clutch(_FIRST_HOLD_S if by_hand else _HOLD_S))
        yield RunContext(
            live=self._rings, stop=mailbox, progress=manager.progress, watchdogs=watchdogs,
            run_observer=self._run_observer, soft_stop=Finish(mailbox, manager.job_number), mailbox=mailbox,
        )  # fmt: skip

    def _held_clutch(self, within_s: float) -> Clutch:
        clutch = Clutch(self._mailbox, self._job_manager.job_number)
        due_s = time.monotonic() + within_s
        while not clutch.held:
            gone = any(watchdog.trip() for watchdog in self._watchdogs)
            if gone or self._mailbox.stop_requested or time.monotonic() > due_s:
                raise TrialError("the clutch was not held (C on the page, a gamepad, a phone): nothing has moved")
            time.sleep(_LOOK_S)
        return clutch

    def log(self, run: PreparedRun, cell: Cell) -> TrialLog | None:
        """See Host: start the log of a run, and show that it has started. Simulated arms that are led need none."""
        if run.led and run.description.simulated:
            return None
        if self._mailbox.stop_requested:
            raise TrialError("stopped by the operator before it began")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        log = run.open_log(self._path, cell.name, self._source.file, cell, self._campaign, self._operator)
        self._job_manager.started(self._path.name, {} if log.cameras is None else log.cameras.rings)
        self._idle.tell(Level.INFO, f"{run.specification.verb} started: {self._path.name}")
        return log


@contextmanager
def _script(faults: str) -> Iterator[Path]:
    """Give a faults file with this text, for the time in which a cell is opened."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as script:
        script.write(faults)
        script.flush()
        yield Path(script.name)
