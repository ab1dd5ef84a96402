"""A cell whose arms are read and never commanded: the loop runs on real states, and no torque is sent."""

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hal.arm import Arm
from hal.cell import LEFT, ArmLink, Cell
from hal.limits import CollisionBehaviour
from hal.state import ArmState
from rtstack.trials.errors import TrialError

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
