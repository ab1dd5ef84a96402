"""One case: a fault at a moment, played in this process, and everything that has to be right afterwards."""

import contextlib
import re
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from mcap.exceptions import McapError

from hal.base.realtime import realtime_thread
from hal.errors import CommandRejected, HardwareError
from hal.fci import FciPair
from hal.robot_errors import error_names
from hal.state import RobotMode
from rtstack.cells import default_cell_file
from rtstack.live.idle import IdleView
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.safety.limits import ForcePhase
from rtstack.samples import SIDES, Mode
from rtstack.trials import record
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.record import TrialLog, open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, run_trial
from sim_robot.profile import load_profile
from tests.support.faults.evidence import MOST_LOST_S, Evidence, beyond_limits, first_violation, read_evidence
from tests.support.faults.hold import hold
from tests.support.faults.model import (
    MODES,
    MOST_TICKS,
    MOVING,
    CaseResult,
    Expected,
    Fault,
    Moment,
    Performed,
    Reaction,
    Recovery,
    Scripted,
)
from tests.support.faults.stage import Stage, posture

IDLE_MOTION_TICKS = 50  # before an idle case: the script counts from a motion
IDLE_AT_TICK = 56  # while the plant comes to rest after it
WATCHED_TICKS = 200
GOES_ON_TICKS = 150  # without a reaction for so long: the session goes on
SMALL_RING = 1024  # records
STILL_RAD = 2e-3
REST_DQ = 0.02  # rad/s
RECOVERY_S = 30.0


@dataclass(frozen=True, slots=True)
class Ground:
    """What all cases stand on: a prepared trial, the tick in which its impact is detected, and the robot.

    clocks: options of `rtstack sim` where the arms do not wait for the loop. One arm's motion begins before the other
    one's then: a scripted fault, whose time counts from the first motion, comes up to `lead_ticks` before its tick of
    the loop, and how late the loop was is not judged by it.
    """

    prepared: PreparedTrial
    impact_tick: int
    profile: str
    clocks: tuple[str, ...] = ()

    def tick(self, moment: Moment) -> int:
        """Return the tick in which the fault of a moment is to be seen."""
        begins = {Moment.INTERIM: self.impact_tick, Moment.POST: self.impact_tick + self._interim_ticks}
        if moment is Moment.STOPPING:
            return MODES[Moment.ANTE][1] + MODES[moment][1]
        return begins.get(moment, 0) + MODES[moment][1]

    @property
    def lead_ticks(self) -> int:
        """Return how much earlier than the loop's first tick the first motion may begin: two slow starts."""
        return 2 * round(load_profile(self.profile).box.move_ms[2]) if self.clocks else 0

    @property
    def leaves_tick(self) -> int:
        """Return when the operator leaves, for the moment stopping."""
        return MODES[Moment.ANTE][1] - self.lead_ticks

    @property
    def _interim_ticks(self) -> int:
        return round(self.prepared.parameters.control.interim_s * 1e3)


class Case:
    """Plays a fault at a moment. `play` once."""

    def __init__(self, fault: Fault, moment: Moment, ground: Ground, folder: Path) -> None:
        self._fault, self._moment, self._ground, self._folder = fault, moment, ground, folder
        self._expected: Expected = fault.expected(moment, bool(ground.clocks))
        self._result = CaseResult(fault.name, moment, self._expected.text)
        self._misses = self._result.misses
        self._fired_at: int | None = None
        self._fired_t_ns = 0
        self._gone_on = self._proven = False
        self._moved_rad: float | None = None

    def play(self) -> CaseResult:
        """Return the cell of the table. Raises nothing: what is raised is a miss."""
        began_s = time.monotonic()
        self._folder.mkdir(parents=True, exist_ok=True)
        idle = self._moment is Moment.IDLE
        performed = isinstance(self._fault.how, Performed)
        stage = Stage(
            self._ground.prepared.description, self._script(), self._fault.own_clocks,
            self._fire if idle and performed else None, self._ground.profile, self._ground.clocks,
        )  # fmt: skip
        try:
            stage.on_tick = lambda mode: self._step(stage, mode)
            if idle:
                self._idle(stage)
            said = self._run(stage)
            self._result.said = said
            self._judge_reaction(stage, said)
            self._recover(stage)
            self._judge_log(stage, said)
        finally:
            stage.close()
        self._result.seconds = round(time.monotonic() - began_s, 1)
        return self._result

    # before and during the run

    def _script(self) -> Path | None:
        if not isinstance(self._fault.how, Scripted):
            return None
        path = self._folder / "faults.toml"
        idle = self._moment is Moment.IDLE
        tick = IDLE_AT_TICK + self._ground.lead_ticks if idle else self._ground.tick(self._moment)
        when = f"at_s = {(tick - 1) * 1e-3:.3f}"
        if self._moment is Moment.INTERIM and self._ground.clocks:
            when = f'when = "first_contact"\ndelay_s = {1e-3 * MODES[self._moment][1]}'
        # a slow box looks for the cause once it has taken its time
        longer_s = self._slowest_recovery_s if self._fault.recovery is Recovery.RESET else 0.0
        path.write_text(self._fault.how.script(when, idle, longer_s), encoding="utf-8")
        return path

    @property
    def _slowest_recovery_s(self) -> float:
        return 1e-3 * load_profile(self._ground.profile).box.recovery_ms[2]

    def _idle(self, stage: Stage) -> None:
        """Move a little, so that a script begins to count; then watch, as the robot process does between two jobs."""
        arms, nothing = stage.pair.arms.values(), np.zeros(7)
        with realtime_thread() if self._ground.clocks else contextlib.nullcontext():
            stage.pair.start()
            for _ in range(IDLE_MOTION_TICKS):
                for arm in arms:
                    arm.read()
                for arm in arms:
                    arm.write(nothing)
            before = np.stack([arm.state.q.copy() for arm in arms])
            for arm in arms:
                arm.stop()
        reads = iter(range(WATCHED_TICKS))
        with Rings.create(capacity=1024) as rings, contextlib.suppress(HardwareError):
            IdleView(rings).watch(stage.cell, lambda: next(reads, None) is None, lambda reason: None, stage.run_events)
        with contextlib.suppress(HardwareError):
            self._moved_rad = float(np.nanmax(np.abs(posture(stage.cell) - before)))
        if isinstance(self._fault.how, Scripted):
            self._fired_at, stage.mode_met = 0, Mode.IDLE

    def _step(self, stage: Stage, mode: Mode) -> None:
        """Between state and answer of each tick: bring the moment about, and the fault.

        What stops the arms of the moment stopping is a fault, too: the operator has gone.
        """
        moment = self._moment
        if moment is Moment.STOPPING and mode is Mode.ANTE_IMPACT and stage.tick == self._ground.leaves_tick:
            stage.signs.operator_leaves()
        if self._fired_at is None and moment is not Moment.IDLE:
            wanted, after = MODES[moment]
            if isinstance(self._fault.how, Scripted):
                # the next state may be one that never comes
                due = stage.tick == self._ground.tick(moment) - 1 - self._ground.lead_ticks
                if self._ground.clocks and moment in (Moment.INTERIM, Moment.STOPPING):
                    due = mode is wanted  # from here on it may come at any time
                stage.seen_from = stage.tick + 1
            else:
                due = mode is wanted and stage.modes.count(int(mode)) > after
            if due:
                self._fire(stage)
        onset = self._onset(stage)
        if onset is not None and stage.stopped_at is None and stage.tick > onset + self._patience:
            self._gone_on = True
            self._proven = self._proof(stage)
            stage.mailbox.request_stop()

    def _proof(self, stage: Stage) -> bool:
        return self._fault.proof is None or self._fault.proof(stage)

    @property
    def _patience(self) -> int:
        return GOES_ON_TICKS + self._expected.sees_after + 2 * self._ground.lead_ticks

    def _fire(self, stage: Stage) -> None:
        self._fired_at = stage.tick
        stage.mode_met = stage.controller.machine.mode
        self._fired_t_ns = int(stage.controller.arms[0].sample["t_ns"][0])
        if isinstance(self._fault.how, Performed):
            self._fault.how.act(stage)

    def _onset(self, stage: Stage) -> int | None:
        return self._fired_at if stage.seen_from is None else stage.seen_from

    def _run(self, stage: Stage) -> str:
        """Run a demonstration or a trial; return what it said of its end."""
        prepared, teleoperated = self._ground.prepared, self._moment is Moment.TELEOPERATION
        specification = DemonstrationSpecification(seed=1) if teleoperated else prepared.specification
        description = prepared.description
        stage.log_path = self._folder / "run.mcap"
        log = self._open_log(stage.log_path, specification)
        context = RunContext(log, stop=stage.mailbox, watchdogs=stage.signs.watchdogs(), run_observer=stage)
        self._tail = log.rings.reader("/left/arm")
        try:
            with stage:
                if isinstance(specification, DemonstrationSpecification):
                    result = run_demonstration(specification, description, stage.cell, context)
                else:
                    result = run_trial(prepared, stage.cell, context)
        except (HardwareError, TrialError, LogError) as error:
            return f"{type(error).__name__}: {error}"
        except Exception as error:
            self._misses.append(f"{type(error).__name__} got out of the run: {error}")
            return f"{type(error).__name__}: {error}"
        said = str(result.failure_reason or "success")
        return said if str(stage.end) in said else f"{said} ({stage.end})"

    def _open_log(self, path: Path, specification: TrialSpecification | DemonstrationSpecification) -> TrialLog:
        create = partial(Rings.create, SMALL_RING) if self._fault.small_ring else Rings.create
        with patch.object(record.Rings, "create", create):
            description = self._ground.prepared.description
            kind = "realtime" if self._ground.clocks else "lockstep"
            return open_log(path, specification, description, kind, default_cell_file(), overwrite=True)

    # what has to be right

    def _judge_reaction(self, stage: Stage, said: str) -> None:
        expected, result, moment = self._expected, self._result, self._moment
        wanted = Mode.IDLE if moment is Moment.IDLE else MODES[moment][0]
        if self._fired_at is None and not (moment is Moment.IDLE and stage.tick < 0):
            self._misses.append("the fault was not brought about")
        elif self._fired_at is not None and stage.mode_met is not wanted:
            met = stage.mode_met.name.lower() if stage.mode_met is not None else "none"
            self._misses.append(f"the fault came in the mode {met}")
        seen = self._reaction(stage)
        result.seen = str(seen)
        if seen not in expected.reactions:
            self._misses.append(f"the reaction is: {result.seen}")
        if not re.search(expected.says, said):
            self._misses.append(f"it says {said!r}, and nothing like {expected.says!r}")
        if moment in MOVING and not (self._proven or self._proof(stage)):
            self._misses.append("nothing shows that the fault was there")

    def _reaction(self, stage: Stage) -> Reaction | str:
        moment = self._moment
        if moment is Moment.STOPPING:
            return Reaction.FIRST_REASON if stage.end is End.OPERATOR_GONE else f"ended as {stage.end}"
        if self._gone_on:
            return Reaction.GO_ON
        if moment is Moment.IDLE:
            return Reaction.NO_MOTION
        if stage.end is End.HARDWARE and stage.stopped_at is None:
            return Reaction.LEAVE
        if stage.stopped_at is not None and stage.end is not End.COMPLETED:
            return Reaction.STOP
        return f"ended as {stage.end}"

    def _judge_latency(self, stage: Stage, evidence: Evidence | None) -> None:
        onset = self._onset(stage)
        if onset is None or self._moment not in MOVING or self._gone_on:
            return
        reacted = stage.tick if stage.stopped_at is None else stage.stopped_at
        if self._fault.physical and evidence is not None:
            hit = self._moment in (Moment.INTERIM, Moment.POST)
            phase = ForcePhase.IMPACT if hit else ForcePhase.CONTACT
            seen = first_violation(evidence, self._ground.prepared.description, onset, phase)
            onset = min(reacted, reacted if seen is None else seen)
        self._result.latency_ticks = reacted - onset
        if self._ground.clocks and (isinstance(self._fault.how, Scripted) or self._fault.log_dies):
            return  # nor is it known when a process that is killed has died
        self._result.allowed_ticks = self._expected.sees_after + MOST_TICKS
        if not 0 <= self._result.latency_ticks <= self._result.allowed_ticks:
            self._misses.append(f"it took {self._result.latency_ticks} ticks, allowed {self._result.allowed_ticks}")

    def _recover(self, stage: Stage) -> None:
        """Let somebody else open the arms, look at them, recover them, and move them."""
        recovery, refusals, deadline_s = self._fault.recovery, [], time.monotonic() + RECOVERY_S
        deadline_s += 2.0 * self._slowest_recovery_s
        if self._moment is Moment.IDLE and recovery is Recovery.RESET and self._gone_on:
            recovery = Recovery.AGAIN
        while True:
            try:
                cell = stage.reconnect()
                if not self._result.robot:
                    self._look_at_robot(stage.pair)
                stage.pair.recover()
                hold(cell, self._ground.prepared.description)
                break
            except HardwareError as error:
                refusals.append(str(error))
            if time.monotonic() > deadline_s:
                self._misses.append(f"no recovery: {refusals[-1]}")
                break
            if recovery is Recovery.NEW_ROBOT and len(refusals) == 1:
                self._result.robot = "gone"
                stage.new_robot()
            time.sleep(0.1)
        if recovery in (Recovery.RESET, Recovery.NEW_ROBOT) and not refusals:
            self._misses.append("the recovery was not refused while the cause persisted")
        self._result.recovered = f"yes, after {len(refusals)} refusals" if refusals else "yes"

    def _look_at_robot(self, pair: FciPair) -> None:
        words, fastest = [], 0.0
        for side, arm in zip(SIDES, pair.arms.values(), strict=True):
            with contextlib.suppress(CommandRejected):
                arm.read()
            state = arm.state
            errors = error_names(state.current_errors)
            words.append(f"{side} {state.robot_mode.name.lower()}" + (f" ({', '.join(errors)})" if errors else ""))
            fastest = max(fastest, float(np.abs(state.record["dq"]).max()))
            if state.robot_mode is RobotMode.MOVE:
                self._misses.append(f"the {side} arm is still in motion")
            reflex = self._fault.reflex or (self._ground.clocks and self._fault.apart is not None)
            if state.robot_mode is RobotMode.REFLEX and self._result.seen == Reaction.STOP and not reflex:
                self._misses.append(f"our stop of the {side} arm ended in a reflex")
        if not fastest < REST_DQ:
            self._misses.append(f"the arms are not at rest: {fastest:.3g} rad/s")
        self._result.robot = ", ".join(words) + (", at rest" if fastest < REST_DQ else "")

    def _judge_log(self, stage: Stage, said: str) -> None:
        newest = self._tail.latest()
        if newest is None:
            self._result.log = "no tick"
            self._judge_latency(stage, None)
            return
        try:
            evidence = read_evidence(stage.log_path)
        except (LogError, McapError) as error:
            self._misses.append(f"the log cannot be read: {error}")
            return
        last_t_ns = self._fired_t_ns if self._fault.log_dies and self._fired_t_ns else int(newest["t_ns"][0])
        missing_s = max(0, last_t_ns - evidence.last_t_ns) * 1e-9
        self._result.log = f"{'recovered' if evidence.recovered else 'complete'}, {1e3 * missing_s:.0f} ms missing"
        if missing_s > (MOST_LOST_S if self._fault.log_dies else 0.0):
            self._misses.append(f"{missing_s:.3f} s of the log are missing")
        if evidence.recovered and not self._fault.log_dies:
            self._misses.append("the log was cut off")
        if not self._fault.log_dies and not re.search(self._expected.says, evidence.text):
            self._misses.append(f"the log does not say {self._expected.says!r}")
        self._misses += beyond_limits(evidence)
        self._judge_latency(stage, evidence)
        if self._moment is Moment.IDLE and not self._gone_on:
            moved = max(float(np.ptp(arm["q"], axis=0).max()) for arm in evidence.arms.values() if len(arm["q"]))
            self._moved_rad = max(moved, self._moved_rad or 0.0)
        pushed = self._ground.clocks and self._fault.physical  # which comes when the arms hold by themselves
        if self._moment is Moment.IDLE and (self._moved_rad or 0.0) > STILL_RAD and not pushed:
            self._misses.append(f"an arm moved by {self._moved_rad:.4f} rad")
