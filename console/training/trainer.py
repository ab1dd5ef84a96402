"""An exercise: a scripted demonstration with a fault at a random moment, what the operator did, and how fast."""

import random
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from console.live.remedies import remedy_of
from console.live.watch import EventView, Watch
from hal.base.configuration import load_toml
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import Status
from rtstack.references.acceptance import Acceptance, AcceptanceError, AcceptanceState, save_acceptance


class Action(StrEnum):
    """What an operator can do about a fault."""

    STOP = "stop"  # nothing else stops the arms
    RECOVER = "recover"  # they have stopped by themselves
    GO_ON = "go on"  # it is none


@dataclass(frozen=True, slots=True)
class Exercise:
    """A fault. script: of it, without its moment; todo: in one line; row: of the runbook, empty for none."""

    name: str
    words: str
    script: str
    action: Action
    todo: str
    row: str = ""

    def faults(self, at_s: float) -> str:
        """Return the text of a faults file in which it comes at_s after the first motion."""
        return f"[[fault]]\nat_s = {at_s:.3f}\n{self.script}"


@dataclass(frozen=True, slots=True)
class _Exercises:
    exercise: tuple[Exercise, ...]


EXERCISES = load_toml(Path(__file__).parents[1] / "pages" / "exercises.toml", _Exercises).exercise
SURPRISE = "surprise"
EARLIEST_S, LATEST_S = 1.2, 3.6  # of the scripted demonstration, which lasts 5 s: on the way, at the impact, in the air
PATIENCE_S = 30.0  # after the fault: what is done later counts for nothing
_LOOK_S = 0.02
_DONE = {"pressed STOP": Action.STOP, "disarmed the cell": Action.STOP, "asked for a recovery": Action.RECOVER}


class Stage(StrEnum):
    """How far an exercise is."""

    WAITING = "waiting"  # the fault has not come yet
    HAPPENED = "happened"
    OVER = "over"


@dataclass(frozen=True, slots=True)
class ExerciseView:
    """What a page shows. fault: empty for a surprise until it has come; did: what the operator did first; after_s: so
    long after the fault, s; right: None until it is over; row: anchor of the runbook's row, empty for none.
    """

    stage: Stage
    fault: str
    job: int
    did: str | None = None
    after_s: float | None = None
    right: bool | None = None
    verdict: str = ""
    todo: str = ""
    row: str = ""


class Trainer:
    """One exercise at a time. May be used from any thread."""

    def __init__(self, watch: Watch, chance: random.Random | None = None) -> None:
        self._watch, self._chance = watch, chance or random.Random()
        self._lock, self._ending = threading.Lock(), threading.Event()
        self.view: ExerciseView | None = None

    def choose(self, name: str) -> tuple[Exercise, float]:
        """Choose fault and moment. Raises RobotRefused for a name that no exercise has."""
        known = {exercise.name: exercise for exercise in EXERCISES}
        if name != SURPRISE and name not in known:
            raise RobotRefused(f"no exercise {name!r}; there are {', '.join(known)} and {SURPRISE}")
        exercise = self._chance.choice(EXERCISES) if name == SURPRISE else known[name]
        return exercise, self._chance.uniform(EARLIEST_S, LATEST_S)

    def follow(self, exercise: Exercise, at_s: float, status: Status, surprise: bool) -> None:
        """Watch an exercise whose job was just ordered."""
        job = 0 if status.job is None else status.job.number
        with self._lock:
            self.view = ExerciseView(Stage.WAITING, "" if surprise else exercise.words, job)
        threading.Thread(target=self._run, args=(exercise, at_s, job), daemon=True, name="exercise").start()

    def close(self) -> None:
        """End what is watched."""
        self._ending.set()

    def _run(self, exercise: Exercise, at_s: float, job: int) -> None:
        number, began_s, fault_s = max((event.number for event in self._watch.events()), default=0), None, None
        seen, since_s, log = False, time.monotonic(), None
        while not self._ending.wait(_LOOK_S):
            status = self._watch.view.status
            now = None if status is None else status.job
            if now is None or now.number != job:
                if not seen and time.monotonic() - since_s < PATIENCE_S:
                    continue  # what the watch shows may be older than the answer to the order
                return self._over(exercise, job, None, None)  # another job has begun
            seen = True
            if log is None and status is not None and (log := now.log) is not None:
                with suppress(AcceptanceError):  # its log is no example to be decided about
                    save_acceptance(
                        Path(status.logs) / log, Acceptance(verdict=AcceptanceState.REJECTED, note="training")
                    )
            now_s = self._watch.robot_time_s()
            # what is seen first may be the last state of the job before, on its clock
            if (began_s is None and self._watch.view.arms[0].mode == "TELEOPERATION") or (began_s or 0.0) > now_s:
                began_s = now_s
            if fault_s is None and began_s is not None and now_s - began_s >= at_s:
                fault_s = time.time()
                self._show(replace(self.view or ExerciseView(Stage.HAPPENED, "", job), stage=Stage.HAPPENED), job)
            did = next((event for event in self._watch.events() if event.number > number and _action(event)), None)
            if did is not None:
                return self._over(exercise, job, did, fault_s)
            late = fault_s is not None and time.time() - fault_s > PATIENCE_S
            if late or (not now.active and (fault_s is None or exercise.action is Action.GO_ON)):
                return self._over(exercise, job, None, fault_s)
        return None

    def _over(self, exercise: Exercise, job: int, event: EventView | None, fault_s: float | None) -> None:
        action = (event and _action(event)) or Action.GO_ON
        after_s = None if event is None or fault_s is None else event.seen_s - fault_s
        early = event is not None and (after_s is None or after_s < 0.0)
        right = action is exercise.action and not early and (event is not None or fault_s is not None)
        if early:
            verdict = "too early: nothing was wrong yet"
        elif right:
            verdict = "right" if after_s is None else f"right, after {after_s:.1f} s"
        elif event is None:
            verdict = f"nothing was done within {PATIENCE_S:g} s" if fault_s is not None else "the fault did not come"
        else:
            verdict = "not what it needs"
        remedy, did = remedy_of(exercise.row), None if event is None else event.text
        row = "" if remedy is None else remedy.anchor
        self._show(ExerciseView(Stage.OVER, exercise.words, job, did, after_s, right, verdict, exercise.todo, row), job)

    def _show(self, view: ExerciseView, job: int) -> None:
        with self._lock:
            if self.view is not None and self.view.job == job:  # else the next exercise has begun
                self.view = view


def _action(event: EventView) -> Action | None:
    """What an operator did, by its event; None for anything else."""
    done = _DONE.items() if event.name == "operator" else ()
    return next((action for words, action in done if words in event.text), None)
