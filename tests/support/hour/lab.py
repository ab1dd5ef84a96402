"""What a step of the hour has: the arm, the person, and what it gives back: claims beside what was found."""

import gc
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from hal.cell import Cell
from hal.errors import CommandRejected, HardwareError
from hal.state import RobotMode
from rtstack.cli.terminal import Terminal
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, CellDescription
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from tests.support.hour.recorder import RecordedArm, Rows, TimedLink, recorded
from tests.support.hour.runs import NOTHING, PreparedHold


class HourTerminal(Terminal):
    """The host of every run of the hour: rtstack's own terminal, whose arm and link are recorded."""

    arm: RecordedArm
    link: TimedLink

    @contextmanager
    def cell(self, run: PreparedRun) -> Iterator[Cell]:
        if self._cell is not None:
            yield self._cell
            return
        with Terminal.cell(self, run) as opened:
            kept, self.arm, self.link = recorded(opened)
            yield kept

    def forget(self) -> None:
        """Keep nothing of an earlier step."""
        if getattr(self, "arm", None) is not None:
            self.arm.clear()
            self.link.clear()

    def keep(self, found: "Found", name: str) -> None:
        """Keep what the arm has shown since then, if anything."""
        if getattr(self, "arm", None) is not None and self.arm.count:
            found.keep(name, self.arm.rows)

    def log(self, run: PreparedRun, cell: Cell) -> None:
        """No log: every step writes what the arm has shown, also where it fails."""


class Skipped(Exception):
    """The person leaves a step out, or it cannot be done here. The message says why."""


@dataclass(frozen=True, slots=True)
class Claim:
    """What rtstack counts on, beside what was found. as_claimed: None where it was not seen."""

    what: str
    claimed: str
    found: str
    as_claimed: bool | None


@dataclass(slots=True)
class Found:
    """What a step gives: claims, figures (JSON-ready once rounded; the unit is in the name), and arrays."""

    claims: list[Claim] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, NDArray] = field(default_factory=dict)

    def claim(self, what: str, claimed: str, found: str, as_claimed: bool | None) -> None:
        """Add a claim."""
        self.claims.append(Claim(what, claimed, found, None if as_claimed is None else bool(as_claimed)))

    def keep(self, name: str, rows: Rows) -> None:
        """Keep the rows under a name."""
        self.arrays |= {f"{name}.{part}": values for part, values in rows.arrays().items()}


@dataclass(slots=True)
class Lab:
    """One arm and one person. share: of the durations, 1 but for a rehearsal.

    led, measured: the hosts of runs for which the cell's geometry need not, and has to, have been measured.
    """

    side: str
    address: str
    kind: str
    description: CellDescription
    cell_file: Path
    share: float
    led: HourTerminal
    measured: HourTerminal
    folder: Path

    @property
    def mounting(self) -> ArmMounting:
        """The arm."""
        return self.description.arms[0]

    @property
    def model(self) -> ArmModel:
        """A new model of the arm."""
        return ArmModel(self.mounting, self.description.pad)

    def ms(self, whole: int, least: int = 400) -> int:
        """Return how many ms of so many a step takes."""
        return max(least, round(whole * self.share))

    def idle(self, milliseconds: int) -> Rows:
        """Read the arm for so long while its box holds it: nothing moves, and no key is needed."""
        with self.open() as cell:
            return self.read(cell, milliseconds)

    @contextmanager
    def open(self) -> Iterator[Cell]:
        """Give the open cell of an arm that is only read."""
        with self.led.cell(PreparedHold(NOTHING, self.description, 1)) as cell:
            yield cell

    def read(self, cell: Cell, milliseconds: int) -> Rows:
        """Read the arm of an open cell for so long."""
        self.led.arm.clear()
        for _ in range(milliseconds):
            cell.arms[0].read()
        return self.led.arm.rows


@dataclass(frozen=True, slots=True)
class Step:
    """number, key: in files; minutes: that it takes; does, you: for the person, before it; word: that has to be typed
    before it; moves: whether the arm is moved, by whomever."""

    number: int
    key: str
    title: str
    minutes: int
    does: str
    you: str
    run: Callable[[Lab], Found]
    word: str = ""
    moves: bool = True


def say(text: str = "", end: str = "\n") -> None:
    """Tell the person."""
    print(text, end=end, file=sys.stderr, flush=True)


def ask(question: str, answers: Sequence[str] = ("",)) -> str:
    """Ask until one of the answers comes; spaces of a held key do not count. "*": anything is an answer."""
    while True:
        say(f"{question}: ", "")
        line = sys.stdin.readline()
        if not line:
            raise KeyboardInterrupt
        answer = line.strip().lower()
        if answer in answers or "*" in answers:
            return answer


def in_reflex(lab: Lab) -> bool:
    """Return whether the arm has stopped by itself and has to be recovered. Raises HardwareError."""
    gc.collect()  # see `recovered`
    with lab.open() as cell:
        return _mode(cell) == RobotMode.REFLEX.name


def recovered(lab: Lab) -> dict[str, Any]:
    """Recover the arm, where it is in reflex, once the person has looked, as often as asked for; return how that
    went."""
    ask("look at the arm, hands off; Enter recovers it")
    while (found := _recovered(lab))["refused"]:
        if ask(f"refused: {found['refused']}\nr: try again; Enter: go on", ("", "r")) == "":
            break
    return found


def _recovered(lab: Lab) -> dict[str, Any]:
    gc.collect()  # a robot has one client: that of the run that was ended
    found: dict[str, Any] = {"mode_before": "", "seconds": 0.0, "refused": "", "mode_after": "", "from": []}
    try:
        with lab.open() as cell:
            found["mode_before"] = _mode(cell)
            lab.led.link.clear()
            cell.recover()
            found["from"], (_, found["seconds"]) = list(lab.led.link.recovered), lab.led.link.recoveries[-1]
            found["mode_after"] = _mode(cell)
    except HardwareError as error:
        found["refused"] = " ".join(str(error).split())
    return found


def _mode(cell: Cell) -> str:
    try:
        return cell.arms[0].read().robot_mode.name
    except CommandRejected:
        return RobotMode.REFLEX.name


def at_a_terminal() -> None:
    """Raise TrialError where no person can answer."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise TrialError("a person answers and holds the space bar: give the command in a terminal")
