"""Runs a campaign on a cell's arms: one case after the other, the object set in its place by the arms before each.

Preparation, such as recording references, is done by workers in the simulator as always. A case's log is the truth: its
row is read back from it, as after a program that was killed.
"""

import random
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from hal.cell import Cell
from rtstack.experiments.experiment import Case, CellRun
from rtstack.experiments.runner import Runner
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.loop.end import OUTSIDE, End
from rtstack.trials.carry_out import Host, PreparedRun, R, carry_out
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedMove, holds
from rtstack.trials.placement import NEAR_DEG, NEAR_MM, difference, object_stands, prepare_placement
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import HandMotion, MoveSpecification, PlacementSpecification

# A run that ended so counts for no controller: a person, a watchdog, this host or the link has ended it.
ABORTS = OUTSIDE | {End.HARDWARE, End.TICK_OVERRUN, End.TORQUE_NOT_TAKEN, End.NOT_AT_REST}
ATTEMPTS = 3  # to set the object in its place


class CellHost(Host, Protocol):
    """A host of runs whose cell stays open, and whose motion a person has allowed for all of them."""

    record: Mapping[str, str] | None  # the metadata record `campaign` of the next log
    log_path: Any  # of the next log, None for none

    @contextmanager
    def kept_cell(self, run: PreparedRun[Any]) -> Iterator[Cell]:
        """Give the cell, open for all runs."""
        ...

    @contextmanager
    def held(self) -> Iterator[RunContext]:
        """Have a person allow the motion of all runs. Raises TrialError."""
        ...


class CellRunner(Runner):
    """One invocation of a campaign on the host's cell; workers prepare what the cases need. See Runner."""

    def __init__(self, *parts: Any, host: CellHost) -> None:
        super().__init__(*parts)
        self.host = host

    def _run(self, cases: list[Case], began_s: float) -> None:
        """Run the cases in an order that is drawn by the campaign's digest: drift is no effect of a condition then.

        Raises TrialError where the cases are of several objects, where the object cannot be set in its place, and where
        a case was aborted: `--resume` goes on.
        """
        order = random.Random(self._experiment.digest).sample(cases, len(cases))
        objects = {self._experiment.on_cell(case).run.specification.object for case in order}
        if len(objects) > 1:
            raise TrialError(f"the plan is of {', '.join(sorted(objects))}: on arms give a plan of one object")
        if not order:
            return
        with self.host.kept_cell(self._experiment.on_cell(order[0]).run) as cell, self.host.held():
            for case in order:
                planned = self._experiment.on_cell(case)
                self._set_in_place(planned, cell)
                planned.log.parent.mkdir(exist_ok=True)
                self.host.log_path, self.host.record = planned.log, planned.record
                result = self._carry_out(planned.run)
                if not self._adopt([case]):
                    raise TrialError(f"{case.id} was aborted, and is run again: {result.failure_reason}")
                self.tally.rows += 1
                self.tally.robot_s += self._experiment.robot_s(result.as_dict())
                self.tally.wall_s = time.perf_counter() - began_s
                self._kept()

    def _adopt(self, cases: list[Case]) -> set[str]:
        """See Runner. The log of a case that was aborted, or is not complete, is put aside: it has no row."""
        found: set[str] = set()
        for case in cases:
            log = self._experiment.on_cell(case).log
            rows = list(self._experiment.adopt([case])) if _counts(log) else []  # what was aborted has no measures
            if not rows:
                _put_aside(log)
                continue
            self._store.add(*rows)
            self._progress.advance()
            found.add(case.id)
        return found

    def _carry_out(self, run: PreparedRun[R]) -> R:
        try:
            return carry_out(run, self.host)
        finally:
            self.host.log_path = self.host.record = None

    def _set_in_place(self, planned: CellRun, cell: Cell) -> None:
        """Have the arms put down what they hold, and carry the object to where the case wants it. Raises TrialError."""
        description, name, wanted = planned.run.description, planned.run.specification.object, planned.wanted
        if holds(cell, description):
            down = self._carry_out(PreparedMove(MoveSpecification(HandMotion.PUT_DOWN, name), description))
            if not down.success:
                raise TrialError(f"{name} could not be put down: {down.failure_reason}")
        x_mm, y_mm, yaw_deg = 1e3 * wanted.x_m, 1e3 * wanted.y_m, wanted.yaw_deg
        placement = prepare_placement(PlacementSpecification(name, x_mm, y_mm, yaw_deg), description)
        for _ in range(ATTEMPTS):
            off_mm, off_deg = difference(object_stands(cell, description, name), wanted)
            if off_mm <= NEAR_MM and off_deg <= NEAR_DEG:
                return
            result = self._carry_out(placement)
            if not result.carried:
                raise TrialError(f"{name} is not in its place: {result.failure_reason}")
        off_mm, off_deg = difference(object_stands(cell, description, name), wanted)
        if off_mm > NEAR_MM or off_deg > NEAR_DEG:
            raise TrialError(f"{name} stands {off_mm:.0f} mm and {off_deg:.0f} degrees from {wanted.in_words}: set it "
                             "there, and go on with --resume")  # fmt: skip


def aborted(reason: str | None) -> bool:
    """Return whether a run ended for a reason that counts for no controller. reason: why it failed, None for success.

    A robot that has left torque control is one: neither a lost link nor a reflex is told apart from the other here.
    """
    return End.in_reason(reason) in ABORTS


def _counts(log: Path) -> bool:
    """Return whether a case has a log with a result, and was not aborted."""
    try:
        result = read_log(log).metadata.get("result", {})
    except LogError:
        return False
    return bool(result) and not aborted(result.get("failure_reason"))


def _put_aside(log: Path) -> None:
    """Keep the log of an attempt that gave no row, under a name that no case has."""
    if log.exists():
        number = next(k for k in count(1) if not log.with_suffix(f".aborted-{k}.mcap").exists())
        log.rename(log.with_suffix(f".aborted-{number}.mcap"))
