"""A command at a terminal as the host of runs (rtstack.trials.carry_out): a cell of its own, a person, Ctrl-C."""

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import typer

from hal.cell import Cell
from hal.errors import CommandRejected, HardwareError
from rtstack.cells import load_description, open_cell, with_profile
from rtstack.cells.commissioning import commissioned, sign
from rtstack.cli.exit_status import FAILED
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.cli.progress import progress_bar
from rtstack.experiments.cell.host import CellHost
from rtstack.live.first_use import FirstUse
from rtstack.log.writer import check_log_path
from rtstack.loop.watchdogs import Parent
from rtstack.model.cell_description import CellDescription
from rtstack.trials.carry_out import PreparedRun, R, carry_out
from rtstack.trials.errors import TrialError
from rtstack.trials.record import TrialLog, free_name
from rtstack.trials.result import Result
from rtstack.trials.run_context import RunContext

_PUT_BACK_S = 1.5  # a simulated robot that has had no client for a second puts its object back


@dataclass(slots=True)
class Terminal(CellHost):
    """Runs on a cell of `kind`. Arms that are not simulated move only while a person holds the space bar.

    what: the motion, for the person who confirms it. bar: the label of the progress bar, "" for none. log_path: of the
    log; None: none of simulated arms, and a free name of real ones. led: see PreparedRun. softly: Ctrl-C brakes along
    the path. record: what the log says of the campaign that the run is part of.
    """

    kind: str
    description: CellDescription
    cell_file: Path
    what: str
    bar: str = ""
    log_path: Path | None = None
    faults: Path | None = None
    led: bool = False
    softly: bool = False
    record: Mapping[str, str] | None = None
    sets_object: bool = False  # see CellHost
    shadow: bool = False  # no arm is moved
    _hold: HoldToRun | None = None
    _cell: Cell | None = None
    _kept: ExitStack = field(default_factory=ExitStack)  # of what is open with it
    _run: Any = None  # the first one on it
    _context: RunContext | None = None
    _paused: str = ""
    _warned: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, cell: str, profile: str | None, cell_file: Path | None, what: str, **more: Any) -> "Terminal":
        """Return the terminal for a command's options. Raises TrialError, ConfigurationError, LogError."""
        kind = with_profile(cell, profile)
        description, source = load_description(cell_file, kind)
        host = cls(kind, commissioned(kind, description, source), source, what, **more)
        if host.log_path is not None:
            check_log_path(host.log_path)
        return host

    def run(self, prepared: PreparedRun[R]) -> R:
        """Carry out a run here."""
        result = carry_out(prepared, self)
        if said := getattr(result, "warning", ""):
            self.warn(said)
        return result

    def check(self) -> HoldToRun:
        """Check that a person can hold the arms to run. Raises TrialError."""
        if self._hold is None:
            self._hold = HoldToRun(self.kind, self.description, self.cell_file, self.led, not self.shadow)
        return self._hold

    @contextmanager
    def cell(self, run: PreparedRun) -> Iterator[Cell]:
        """Give a cell that is open for one run, or the one that is kept. Raises TrialError, HardwareError."""
        if self._cell is not None:
            yield self._cell
            return
        self.check()
        FirstUse(len(self.description.sides)).wait()
        asked = run.specification
        cell = open_cell(
            self.kind, asked.object, run.displacement, asked.seed, self.description, self.faults, run.noise_seed,
            self.cell_file, led=self.led,
        )  # fmt: skip
        if cell.warning:
            self.warn(cell.warning)
        try:
            yield cell
        except CommandRejected as error:
            if cell.link is None or not error.errors:
                raise
            raise CommandRejected(f"{error}: rtstack recover-arms --cell {self.kind}", error.errors) from None
        finally:
            cell.close()

    @contextmanager
    def kept_cell(self, run: PreparedRun) -> Iterator[Cell]:
        """Keep the cell of a first run open for several."""
        with ExitStack() as self._kept:
            self._cell, self._run = self._kept.enter_context(self.cell(run)), run
            try:
                yield self._cell
            finally:
                self._cell = None

    def put_back(self) -> Cell | None:
        """See CellHost. A simulated robot puts the object back while no client is connected."""
        return None if self.has_person else self._opened_again(_PUT_BACK_S)

    def _opened_again(self, after_s: float = 0.0) -> Cell:
        self._cell = None
        self._kept.close()
        time.sleep(after_s)
        self._cell = self._kept.enter_context(self.cell(self._run))
        return self._cell

    def warn(self, text: str) -> None:
        """Print a line, once."""
        if text not in self._warned:
            self._warned.add(text)
            print(f"rtstack: warning: {text}", file=sys.stderr)

    def announce(self, text: str) -> None:
        """Print a line, with the terminal's bell."""
        print(f"\artstack: {text}", file=sys.stderr, flush=True)

    def carry_out(self, run: PreparedRun[R], log: Path, record: Mapping[str, str] = {}) -> R:
        self.log_path, self.record = log, record or None
        return carry_out(run, self)

    def recover(self) -> Cell | None:
        """See CellHost. Arms that were lost are connected to again."""
        assert self._cell is not None, "no cell is kept"
        try:
            with suppress(HardwareError):
                self._cell.recover()
                return None
            cell = self._opened_again()
            cell.recover()
        except HardwareError as error:
            raise TrialError(f"the arms do not recover: {error}") from None
        return cell

    def sign(self, step: str, by: str, values: Mapping[str, float | str], log: str | None = None) -> None:
        """Sign a step of commissioning. Raises ConfigurationError."""
        description, file = load_description(self.cell_file, self.kind)
        sign(step, by, values, description, file, log=Path(log or "").name)

    @property
    def has_person(self) -> bool:
        return self.check().needed

    @property
    def stopped(self) -> str:
        stop = None if self._context is None else self._context.stop
        return "stopped between two runs" if stop is not None and stop.stop_requested else ""

    @property
    def paused(self) -> str:
        return self._paused

    def look(self, reason: str) -> None:
        if self.has_person:
            self._paused = f"{reason}: look at the cell, then press p to go on"

    def ask(self, what: str) -> None:
        if not self.has_person:
            raise TrialError(f"{what}: simulated arms have no person who does; --cell lockstep does it by itself")
        self._paused = f"{what}, then press p"

    def _toggle_pause(self) -> None:
        self._paused = "" if self._paused else "paused: press p to go on"

    @contextmanager
    def watched(self) -> Iterator[RunContext]:
        """See CellHost. Raises TrialError without confirmation."""
        with interruptible() as stop, self.check().watched(self.what, stop, self._toggle_pause):
            self._context = RunContext(stop=stop, watchdogs=(Parent(),))
            try:
                yield self._context
            finally:
                self._context = None

    @contextmanager
    def held(self, bar: bool = True) -> Iterator[RunContext]:
        """Have a person hold the arms to run, for one run or several. Raises TrialError without confirmation."""
        with (
            interruptible() as stop,
            self.check().held(self.what, stop) as held,
            progress_bar(self.bar, bool(self.bar) and bar) as progress,
        ):
            hard, soft = (None, stop) if self.softly else (stop, None)
            self._context = RunContext(stop=hard, progress=progress, watchdogs=(Parent(), *held), soft_stop=soft)
            try:
                yield self._context
            finally:
                self._context = None

    @contextmanager
    def accompany(self, run: PreparedRun, cell: Cell) -> Iterator[RunContext]:
        if self._context is not None:
            yield replace(self._context, progress=None)  # the bar is that of all runs
        else:
            with self.held(not cell.own_clocks) as context:
                yield context

    def log(self, run: PreparedRun, cell: Cell) -> TrialLog | None:
        path = self.log_path
        if path is None and not self.check().real:
            return None
        if path is None:  # no motion of real arms without a record
            path = free_name(Path("logs"), run.specification.log_stem)
            with suppress(OSError):  # the log says why it cannot be written
                path.parent.mkdir(exist_ok=True)
            print(f"rtstack: log: {path}", file=sys.stderr)
        return run.open_log(path, self.kind, self.cell_file, cell, self.record)


def report(result: Result, json: bool, line: str, ran: bool = False) -> None:
    """Print a result. Raises Exit where the run has failed. ran: it did what was asked, whatever came out."""
    typer.echo(result.as_json() if json else line)
    if not (result.success or ran):
        raise typer.Exit(FAILED)
