"""Runs a campaign on a cell's arms, one case after the other. A case's log is the truth: its row is read from it."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError
from rtstack.experiments.attempts import Attempt, Kind, aborted
from rtstack.experiments.case_log import case_log, row_of
from rtstack.experiments.cell.host import CellHost
from rtstack.experiments.cell.reset import Reset, ResetAborted
from rtstack.experiments.cell.schedule import control_case, ordered, schedule_of
from rtstack.experiments.experiment import Case, CellRun, Stage
from rtstack.experiments.runner import Runner
from rtstack.loop.end import End
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.start_motion import WayRefused

RESETS = "resets"  # the folder of the logs of what brings arms and object to where a case begins
LOOK_S = 0.2  # between two looks at a person's work, or whether a pause is over


class CellRunner(Runner):
    """One invocation of a campaign on the host's cell. See Runner."""

    def __init__(self, *parts: Any, host: CellHost) -> None:
        super().__init__(*parts)
        self.host = host
        self._schedule = schedule_of(self._experiment.specification)
        self._failures: list[str] = []  # of the cases in a row that have failed until now
        self._began_s = self._work_s = 0.0
        self._latched = False  # the arms may have latched an error in the last run
        self._setup = "" if host.has_person else self._experiment.setup  # a person is asked once more on --resume
        self._at_start = False  # the arms stand where a run or a placement of ours has left them
        self._held = ExitStack()
        self._reset: Reset | None = None

    def run(self) -> None:
        """See Runner. The cell is opened, and a person asked, when the first motion is due."""
        with ExitStack() as self._held:
            super().run()

    def _reset_for(self, planned: CellRun, name: str) -> Reset:
        """Return the cell's reset; opens the cell the first time, for this run."""
        if self._reset is None:
            cell = self._held.enter_context(self.host.kept_cell(planned.run))
            self._held.enter_context(self.host.watched())
            by_arms = self._schedule.placed_by == "arms"
            self._reset = Reset(cell, self._carry_out, self._wait, by_arms, self.host.put_back)
            self._work_s = time.monotonic()
        return self._reset

    def _prepare(self, stage: Stage) -> dict[str, str]:
        """See Runner. Raises TrialError where a person, a watchdog or the link has ended a run."""
        if stage.on_cell is None or not stage.tasks:
            return super()._prepare(stage)
        self._progress.begin(stage.label, 0, len(stage.tasks))
        failed: dict[str, str] = {}
        for name in (task.name for task in stage.tasks):
            try:
                planned = stage.on_cell(name)
                planned = replace(planned, record={"digest": self._experiment.digest, **planned.record})
            except ConfigurationError as error:
                failed[name] = str(error)
                continue
            if reason := self._prepared(planned, name):
                failed[name] = reason
            self._progress.advance()
        return failed

    def _prepared(self, planned: CellRun, name: str) -> str | None:
        """Carry out a run of a stage; returns why it failed. Raises TrialError where it was aborted."""
        attempts = count(1)
        while aborted(reason := self._once(planned, name, Kind.PREPARATION, planned.log).failure_reason):
            planned.log.unlink(missing_ok=True)
            self._again(next(attempts), reason, f"{name} was aborted, and is run again: {reason}")
        return reason

    def _run(self, cases: list[Case], began_s: float) -> None:
        """Run the cases in the schedule's order. Raises TrialError where a person has to look: `--resume` goes on."""
        every: list[Case] = list(self._experiment.cases(self._store.rows()))
        missing = {case.id for case in cases}
        setup_of = {case.id: self._experiment.on_cell(case).setup for case in every}
        order = ordered(
            every, self._schedule, self._experiment.digest, lambda case: setup_of[case.id], self._experiment.setup
        )
        order = [case for case in order if case.id in missing]
        control = control_case(every, self._schedule)
        objects = {self._experiment.on_cell(case).run.specification.object for case in order}
        if len(objects) > 1:
            raise TrialError(f"the plan is of {', '.join(sorted(objects))}: on arms give a plan of one object")
        self._began_s = began_s
        if control is not None and order:
            for _ in range(self._schedule.warm_up):
                self._repeat(control, Kind.WARM_UP)
        for k, case in enumerate(order):
            if control is not None and k % self._schedule.control_every == 0:
                self._repeat(control, Kind.CONTROL)
            self._rest()
            self._progress.say_next(order[k + 1].id if k + 1 < len(order) else "")
            self._case(case)
        if control is not None and order:
            self._repeat(control, Kind.CONTROL)

    def _case(self, case: Case) -> None:
        """Run a case until it has a row. Raises TrialError where a person has to look first."""
        planned = self._experiment.planned(case)
        result: Any = None
        for attempt in count(1):
            result = self._once(planned, case.id, Kind.CASE, planned.log)
            reason = self._uncounted(result.failure_reason, result.missed_deadlines)
            if self._adopt([case]):
                break
            why = f"{case.id} was aborted, and is run again: {reason or 'its log is not complete'}"
            self._again(attempt, reason, why)
        self.tally.rows += 1
        self.tally.robot_s += self._experiment.robot_s(result.as_dict())
        self.tally.wall_s = time.perf_counter() - self._began_s
        self._kept()
        self._failures = [] if result.success else [*self._failures, result.failure_reason]
        if len(self._failures) >= self._schedule.failures_in_a_row:
            raise TrialError(f"{len(self._failures)} cases in a row have failed, the last one since "
                             f"{self._failures[-1]}: look at the cell, then go on with --resume")  # fmt: skip

    def _repeat(self, control: Case, kind: Kind) -> None:
        """Run the control case once more; its log has a number, its row stands with the attempt."""
        planned, word = self._experiment.planned(control), kind.replace(" ", "-")
        planned = replace(planned, record={**planned.record, "repeats": word})
        for attempt in count(1):
            result = self._once(planned, control.id, kind, _unused(planned.log, word), control)
            if not aborted(result.failure_reason):
                return
            self._again(attempt, result.failure_reason, f"the {kind} was aborted: {result.failure_reason}")

    def _again(self, attempt: int, reason: str | None, why: str) -> None:
        """Raise TrialError with `why` unless a run that ended for this reason, if any, may have another attempt."""
        if not (reason is None or _mends(reason)) or attempt >= self._schedule.attempts:
            raise TrialError(why)

    def _once(self, planned: CellRun, name: str, kind: Kind, log: Path, control: Case | None = None) -> Any:
        """Run once, with the object in its place. name: of the case, or of the stage's task."""
        reset, attempt = self._reset_for(planned, name), 0
        while True:
            attempt += 1
            self._wait(lambda: self.host.paused, Kind.PERSON, name)
            if self._latched:
                self._latched = False
                reset.cell = self.host.recover() or reset.cell
            if planned.setup != self._setup:
                self._setup = planned.setup
                self.host.ask(planned.setup)
                continue
            try:
                if not self.host.sets_object:
                    if not self._at_start:  # the arms may stand anywhere
                        reset.go_to_start(planned, name)
                        self._at_start = True
                    reset.set_in_place(planned, name)
                if not self._latched and not self.host.paused:  # by a placement, or by a person meanwhile
                    return self._carry_out(planned.run, kind, name, control, log, planned.record)
            except ResetAborted as error:
                self._at_start = False
                stopped = End.in_reason(error.reason) is End.SAFETY  # the person, if any, has looked
                if not (stopped or _mends(error.reason)) or attempt >= self._schedule.attempts:
                    raise
            except WayRefused:  # nothing has moved
                if self.host.sets_object or not self._at_start or attempt >= self._schedule.attempts:
                    raise
                self._at_start = False

    def _carry_out(
        self, run: PreparedRun[Any], kind: Kind, name: str, control: Case | None = None, log: Path | None = None,
        record: Mapping[str, str] = {},
    ) -> Any:  # fmt: skip
        """Carry out a run and note it, also where the host raises. log: by default one beside the others."""
        if log is None:  # a pause, or a look after a fault, comes before each run that brings the arms and the object
            self._wait(lambda: self.host.paused, Kind.PERSON, name)
            log = _unused(self._store.out / RESETS / f"{name.replace('/', '-')}.mcap", kind.replace(" ", "-"))
        log.parent.mkdir(exist_ok=True)
        began, began_s = _now(), time.monotonic()
        try:
            result = self.host.carry_out(run, log, record)
        except Exception as error:
            self._store.note_attempt(Attempt(began, kind, name, str(error), False, time.monotonic() - began_s))
            raise
        values, reason = result.as_dict(), result.failure_reason
        counts = self._uncounted(reason, values.get("missed_deadlines", 0)) is None
        row = row_of(self._experiment, control, log) if counts and control is not None else None
        self._store.note_attempt(Attempt(
            began, kind, name, reason, counts and kind is Kind.CASE, time.monotonic() - began_s,
            *(values.get(each) for each in ("off_mm", "off_deg", "peak_force_n")),
            log=log.name, row=None if row is None else json.dumps(row),
        ))  # fmt: skip
        self._latched = End.in_reason(reason) is End.HARDWARE
        self._at_start &= not End.in_reason(reason).is_fault and not aborted(reason)
        if End.in_reason(reason).is_fault:
            self.host.look(f"{name}: {reason}")
        return result

    def _uncounted(self, reason: str | None, late_cycles: int) -> str | None:
        """Return why a run counts for nothing, None where it counts. reason: why it failed."""
        most = self._schedule.late_cycles
        if aborted(reason):
            return reason
        return f"{End.TICK_OVERRUN}: {late_cycles} late cycles" if most is not None and late_cycles > most else None

    def _rest(self) -> None:
        schedule = self._schedule
        if schedule.work_min is None or time.monotonic() - self._work_s < 60.0 * schedule.work_min:
            return
        end_s = time.monotonic() + 60.0 * schedule.rest_min

        def said() -> str:
            left_s = end_s - time.monotonic()
            return f"the arms rest for {left_s:.0f} s more" if left_s > 0.0 else ""

        self._wait(said, Kind.REST, "")
        self._work_s = time.monotonic()

    def _wait(self, said: Callable[[], str], kind: Kind, case_id: str) -> None:
        """Wait, telling the person why, until there is nothing to tell; note it. Raises TrialError at a stop."""
        began, began_s = _now(), time.monotonic()
        waited = False
        try:
            while not (stopped := self.host.stopped) and (text := said()):
                waited = True
                self._progress.tell(text)
                time.sleep(LOOK_S)
        finally:
            if waited:
                self._progress.tell("")
                self._store.note_attempt(Attempt(began, kind, case_id, None, False, time.monotonic() - began_s))
        if stopped:
            raise TrialError(f"{stopped}: go on with --resume")

    def _adopt(self, cases: list[Case]) -> set[str]:
        """See Runner. The log of a case that was aborted, or is not complete, is put aside: it has no row."""
        found: set[str] = set()
        for case in cases:
            path, row = self._experiment.on_cell(case).log, None
            if (log := case_log(path, case, self._experiment.digest)) is not None:
                result = log.metadata["result"]
                if not self._uncounted(result["failure_reason"], int(result.get("missed_deadlines", 0))):
                    row = row_of(self._experiment, case, path)
            if row is not None:
                found.add(self._keep(row))
            elif path.exists():
                path.rename(_unused(path, "aborted"))
        return found


def _mends(reason: str | None) -> bool:
    """Return whether a run that was aborted so may run again: the arms stand in order, or are recovered before."""
    return End.in_reason(reason) in (End.TICK_OVERRUN, End.HARDWARE)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _unused(log: Path, word: str) -> Path:
    return next(path for k in count(1) if not (path := log.with_suffix(f".{word}-{k}.mcap")).exists())
