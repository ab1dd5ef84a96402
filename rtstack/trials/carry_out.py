"""Carries out a run: open the cell, start motion, log, run. The only place that does it, whatever asks for the run.

A kind of run is a subclass of PreparedRun. Where it runs (terminal, robot process, campaign's worker) is a Host.
"""

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hal.arm import Arm
from hal.cell import LEFT, ArmLink, Cell
from hal.displacement import Displacement
from hal.limits import CollisionBehaviour
from hal.state import ArmState
from rtstack.control.modes import Strategy
from rtstack.control.parameters import DetectorParameters
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import cell_controller, cell_parameters, following
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.record import RunLog, TrialLog, open_log
from rtstack.trials.result import Result
from rtstack.trials.run_context import RunContext
from rtstack.trials.sight import check_sight
from rtstack.trials.start_motion import StartMotion, start_motion

_WAITED_S, _LONGEST_S = 3e-4, 0.5


class _ShadowArm:
    """An arm that its robot or a person holds. Its states show as tau_J_d the torque that would have been sent."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._state, self._tau = arm, ArmState.empty(), np.zeros(7)
        self.close = arm.close

    def read(self) -> ArmState:
        self._state.record[:] = self._arm.read().record
        self._state.record["tau_J_d"][0] = self._tau
        return self._state

    def write(self, tau: NDArray[np.float64]) -> None:
        """Keep the torque (7,), Nm, and send nothing."""
        self._tau[:] = tau

    def stop(self) -> None:
        self._tau[:] = 0.0

    def recover(self) -> None:
        """Do nothing: a robot recovers when it is to move."""


class _ShadowLink:
    def __init__(self, link: ArmLink, arms: tuple[_ShadowArm, ...]) -> None:
        self._arms = arms
        self.wait, self.close = link.wait, link.close

    def start(self) -> None:
        """Leave the robots in their own control, and read what has queued up: a read that waits is of a new state."""
        for arm in self._arms:
            end_s = before_s = time.monotonic()
            while before_s < end_s + _LONGEST_S:
                arm.read()
                now_s = time.monotonic()
                if now_s - before_s > _WAITED_S:
                    break
                before_s = now_s

    def set_collisions(self, *arms: CollisionBehaviour) -> None:
        """Leave the robots' thresholds as they are."""

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        for arm in self._arms:
            arm.stop()

    def recover(self) -> tuple[str, ...]:
        return ()


def shadow_of(cell: Cell) -> Cell:
    """Return the open cell with arms that are never commanded; the caller closes the cell itself. Raises TrialError for
    arms that show no new state without an answer."""
    if cell.waits:
        raise TrialError(
            f"a shadow needs arms that do not wait for answers: {cell.name} does; take direct, or realtime"
        )
    arms = {side: _ShadowArm(arm) for side, arm in zip(cell.sides, cell.arms, strict=True)}
    link = None if cell.link is None else _ShadowLink(cell.link, tuple(arms.values()))
    return replace(cell, **arms, link=link)  # pyright: ignore[reportArgumentType]


R = TypeVar("R", bound=Result)
_LOOK_S = 0.02


@dataclass(frozen=True, slots=True)
class PreparedRun(Generic[R]):
    """A run whose specification was read and checked; no cell and no log is open yet. Base of all kinds of run.
    keeps_open_cell: it runs on the cell as it is, with what the pads hold. led: a person leads the arms, whose geometry
    need not have been measured. watched: the tracker has to be readable."""

    keeps_open_cell: ClassVar[bool] = False
    watched: ClassVar[bool] = True
    led: ClassVar[bool] = False
    specification: Any
    description: CellDescription

    @property
    def displacement(self) -> Displacement:
        """The displacement of the object in the cell that is opened."""
        return self.specification.displacement

    @property
    def noise_seed(self) -> int | None:
        """Seed of a simulated cell's noise; None: that of the specification."""
        return None

    @property
    def shadow(self) -> bool:
        """Whether no torque is sent: the arms stay where their robots or a person hold them."""
        return getattr(self.specification, "shadow", False)

    @property
    def refusal(self) -> str:
        """Why the cell refuses this kind of run, "" where it does not."""
        return self.description.refusal(self.specification)

    def look(self, cell: Cell) -> str:
        """Return in one line what is to be known of the open cell before it runs, "" for nothing. Raises TrialError."""
        if self.led or self.keeps_open_cell:  # a hand may be on an arm, and the pads hold something
            return ""
        return check_estimate(cell, self.description, DetectorParameters(), detects=False)

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """Return the motion to where the run begins, by default to home; None where the arms begin anywhere. Raises
        TrialError, HardwareError."""
        if self.keeps_open_cell or self.led:
            return None
        return start_motion(cell, self.description, self.specification.object, self.displacement)

    def about(self) -> dict[str, Any]:
        """Return what the log has of this kind besides the common: keyword arguments of open_log."""
        return {}

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> R:
        """Run on the open cell. way: the start motion, before the first tick. Closes the context's log."""
        raise NotImplementedError

    def open_log(
        self, path: Path, cell_kind: str, cell_file: Path, cell: Cell, campaign: Mapping[str, str] | None = None,
        operator: str = "",
    ) -> TrialLog:  # fmt: skip
        """Start the log of the run. campaign, operator: which campaign and operator ordered it. Raises LogError."""
        return open_log(
            path, self.specification, self.description, cell_kind, cell_file, cell=cell, campaign=campaign,
            operator=operator, **self.about(),
        )  # fmt: skip


class Host(Protocol):
    """Where a run is carried out: which cell it gets, what accompanies it, and where its log goes."""

    def cell(self, run: PreparedRun) -> AbstractContextManager[Cell]:
        """Give the open cell. Raises HardwareError."""
        ...

    def warn(self, text: str) -> None:
        """Show a person one line about the cell."""

    def announce(self, text: str) -> None:
        """Show a person one line about the motion that is about to begin, with a sound."""

    def accompany(self, run: PreparedRun, cell: Cell) -> AbstractContextManager[RunContext]:
        """Give what accompanies the run, without its log: a person has allowed the motion. Raises TrialError."""
        ...

    def log(self, run: PreparedRun, cell: Cell) -> RunLog | None:
        """Start the log; None where none is written. Raises LogError, TrialError."""


def _count_down(run: PreparedRun, context: RunContext, announce: Callable[[str], None]) -> None:
    """Count the seconds before a motion of real arms. Raises TrialError where a watchdog or a stop ends it."""
    if run.description.simulated or run.led or run.shadow:
        return
    for left in range(run.description.countdown_s, 0, -1):
        announce(f"the arms move in {left} s")
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            stopped = context.stop is not None and context.stop.stop_requested
            if stopped or any(watchdog.trip() is not None for watchdog in context.watchdogs):
                raise TrialError("interrupted while it was counted down: nothing has moved")
            time.sleep(_LOOK_S)


def carry_out(run: PreparedRun[R], host: Host) -> R:
    """Carry out a prepared run. Raises TrialError, LogError, HardwareError; then no arm has moved."""
    if run.refusal:
        raise TrialError(run.refusal)
    if not run.description.simulated:  # compiled, or loaded, before a robot is connected to and a person is asked
        cell_controller(run.description, cell_parameters(run.description), following(Strategy.PROPOSED), 0.0)
    with host.cell(run) as cell:
        if run.shadow:
            cell = shadow_of(cell)
        if said := run.look(cell):
            host.warn(said)
        if run.watched and not (run.led or run.shadow):
            check_sight(cell, run.description, getattr(run.specification, "object", ""))
        way = None if run.shadow else run.start_motion(cell)
        with host.accompany(run, cell) as context:
            _count_down(run, context, host.announce)
            log = host.log(run, cell)
            try:
                return run.run(cell, replace(context, log=log), way)
            except BaseException:  # before its first tick: a run that has begun finishes its log itself
                if log is not None:
                    log.abandon()
                raise
