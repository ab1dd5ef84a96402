"""Where a case is played: a simulated robot, both arms over pylibfranka, a log, and who watches the session's ticks."""

import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import cast
from unittest.mock import patch

import numpy as np
import psutil

from hal.cell import Cell
from hal.fci import FciPair, open_pair
from rtstack.cells.simulator import Simulator
from rtstack.control.tick import CellController
from rtstack.loop import watchdogs
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.watchdogs import CONSOLE_S, OPERATOR_S, Heartbeat, Parent, Watchdog
from rtstack.model.cell_description import CellDescription
from rtstack.safety.judge import SafetyJudge
from rtstack.samples import Mode
from rtstack.trials import run
from rtstack.trials.run_context import RunEvent

BEAT_S = 0.1


class Signs:
    """Operator, console and parent, as the robot process knows them."""

    def __init__(self, mailbox: Mailbox) -> None:
        self._mailbox = mailbox
        self._operator = self._console = True
        self._over = threading.Event()
        self._beat()
        self._thread = threading.Thread(target=self._keep_beating, daemon=True)
        self._thread.start()

    def _beat(self) -> None:
        now_ns = time.monotonic_ns()
        if self._operator:
            self._mailbox.operator_beat(now_ns)
        if self._console:
            self._mailbox.console_beat(now_ns)

    def _keep_beating(self) -> None:
        while not self._over.wait(BEAT_S):
            self._beat()

    def watchdogs(self) -> tuple[Watchdog, ...]:
        """Return what the robot process watches."""
        return (
            Heartbeat(lambda: self._mailbox.console_beat_ns, CONSOLE_S, End.CONSOLE_GONE),
            Heartbeat(lambda: self._mailbox.operator_beat_ns, OPERATOR_S, End.OPERATOR_GONE),
            Parent(),
        )

    def operator_leaves(self) -> None:
        """No more sign of life; the last one is too old."""
        self._operator = False
        self._mailbox.operator_beat(time.monotonic_ns() - round(1.01e9 * OPERATOR_S))

    def console_leaves(self) -> None:
        """As operator_leaves."""
        self._console = False
        self._mailbox.console_beat(time.monotonic_ns() - round(1.01e9 * CONSOLE_S))

    def close(self) -> None:
        """Beat no more."""
        self._over.set()
        self._thread.join()


class Stage:
    """One robot, one session at a time. `tick`: of the running session; `stopped_at`: the first with a stopping torque.

    mode_met: the session's mode when the fault came; seen_from: the first tick in which the loop can see it.
    """

    def __init__(
        self,
        description: CellDescription,
        script: Path | None,
        own_clocks: bool,
        begin: Callable[["Stage"], None] | None,
        profile: str,
        clocks: Sequence[str] = (),
    ) -> None:
        """clocks: options of `rtstack sim` for arms that do not wait for the loop, each by its own clock."""
        self._stack = ExitStack()
        self.mailbox = Mailbox.create(f"rtstack-{os.getpid()}-mailbox")
        self._stack.callback(self.mailbox.close)
        self.signs = Signs(self.mailbox)
        self._stack.callback(self.signs.close)
        self._tool = description.pad
        self._profile = profile
        self._clocks, self.apart = tuple(clocks), bool(clocks)
        self.simulator = self._simulator(script)
        self._stack.callback(self.simulator.close)
        self.own_clocks = own_clocks or bool(clocks)
        self.pair = self.connect()
        self.cell = replace(self._cell(self.pair), own_clocks=self.own_clocks)
        self._begin = begin
        self.controller: CellController
        self.judges: tuple[SafetyJudge, ...]
        self.log_path = Path()
        self.log_process: psutil.Process
        self.frozen: list[psutil.Process] = []
        self.tick = -1
        self.stopped_at: int | None = None
        self.limited_at: int | None = None
        self.mode_met: Mode | None = None
        self.seen_from: int | None = None
        self.modes: list[int] = []
        self._judged = [0, 0]
        self.pose_tick, self._pose_t_ns = 0, -1  # when the last new pose of the object came
        self._stamps: list[int] = []  # of the left arm's states
        self.end: End | None = None
        self.on_tick: Callable[[Mode], None] = lambda mode: None

    def _simulator(self, script: Path | None = None) -> Simulator:
        return Simulator(
            "rice_box", 0.0, 1, lockstep=not self._clocks, faults=script, profile=self._profile, more=self._clocks
        )

    def connect(self) -> FciPair:
        """Open both arms. Raises HardwareError."""
        return open_pair(
            self.simulator.left, self.simulator.right, (self._tool, self._tool), shared_clock=not self._clocks
        )

    def _cell(self, pair: FciPair) -> Cell:
        kind, own_clocks = ("realtime", True) if self._clocks else ("lockstep", False)
        return Cell(kind, pair.left, pair.right, self.simulator.tracker, pair, own_clocks=own_clocks)

    def reconnect(self) -> Cell:
        """Let go of both arms, open them again, and return them. Raises HardwareError."""
        self.pair.close()
        self.pair = self.connect()
        return self._cell(self.pair)

    def new_robot(self) -> None:
        """Replace the robot by another one. Raises HardwareError."""
        self.simulator.close()
        self.simulator = self._simulator()
        self._stack.callback(self.simulator.close)

    def _find_log_process(self) -> psutil.Process:
        for child in psutil.Process().children():
            if "rtstack.log.writing.process" in child.cmdline():
                return child
        raise AssertionError("there is no log process")

    def largest_gap_ticks(self) -> int:
        """Return the longest time, in ticks, between two states of the left arm that the loop has seen."""
        return round(float(np.diff(self._stamps[2:], prepend=self._stamps[2]).max()) * 1e-6)

    def __enter__(self) -> "Stage":
        """From now on the controllers and judges that a run makes are looked at, tick by tick."""
        make_controller, make_judges = run.cell_controller, run.safety_judges

        def controller(*arguments, **more) -> CellController:
            self.controller = cast(CellController, make_controller(*arguments, **more))
            decide = self.controller.decide

            def decided(t_s: float) -> None:
                decide(t_s)
                self.modes.append(int(self.controller.machine.mode))
                self._stamps.append(int(self.controller.arms[0].sample["t_ns"][0]))
                self.on_tick(self.controller.machine.mode)

            self.controller.decide = decided
            return self.controller

        def judges(*arguments, **more) -> tuple[SafetyJudge, ...]:
            self.judges = make_judges(*arguments, **more)
            for side, judge in enumerate(self.judges):
                self._look_at(side, judge)
            self.tick = 0
            self.log_process = self._find_log_process()  # before a clock runs: it takes some ms
            if self._begin is not None:
                self._begin(self)
            return self.judges

        self._patches = ExitStack()
        self._patches.enter_context(patch.object(run, "cell_controller", controller))
        self._patches.enter_context(patch.object(run, "safety_judges", judges))
        # this robot waits: what a busy machine takes is no overrun, the 30 ms of the fault are
        self._patches.enter_context(patch.object(watchdogs, "_PERIOD_NS", 20_000_000))
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._patches.close()

    def _look_at(self, side: int, judge: SafetyJudge) -> None:
        judge_it = judge.judge

        def judged(*arguments, **more):
            verdict = judge_it(*arguments, **more)
            if judge.stopping and self.stopped_at is None:
                self.stopped_at = self.tick
            if judge.limited and self.limited_at is None:
                self.limited_at = self.tick
            self._judged[side] += 1
            self.tick = max(self._judged) if self.own_clocks else self._judged[1]
            if side == 1 and (seen := self.cell.tracker.latest().t_ns) != self._pose_t_ns:
                self._pose_t_ns, self.pose_tick = seen, self.tick
            return verdict

        judge.judge = judged

    # a RunObserver

    def run_events(self) -> list[RunEvent]:
        """Say nothing."""
        return []

    def ended(self, end: End, detail: str) -> None:
        """Take how the session ended."""
        self.end = end

    def close(self) -> None:
        """End everything, also what was frozen."""
        for process in self.frozen:
            if process.is_running():
                process.resume()
        self.pair.close()
        self._stack.close()


def posture(cell: Cell) -> np.ndarray:
    """Return where both arms are, (2, 7) rad. Raises HardwareError."""
    return np.stack([arm.read().q.copy() for arm in cell.arms])
