"""Hands and gizmos that lead the pads: where each of them, and both pads, were when it began to; and drags to undo."""

from collections import deque

import numpy as np

from console.teleoperation.devices import Dragged, Tracked
from console.teleoperation.quaternion import angle_between
from hal.arrays import Array

_UNDO_DEPTH = 20  # drags
_UNDONE_M, _UNDONE_RAD = 2e-3, 5e-3  # a drag that asks for less than this is none


class Grips:
    """One a side, 0 for left. Not for two threads at a time. asked: the requests, (2, 7), when something was said."""

    def __init__(self) -> None:
        self.dragged: set[int] = set()  # sides whose gizmo is being dragged, followed or not
        self.drags: deque[Array] = deque(maxlen=_UNDO_DEPTH)  # what was asked for before each drag that was followed
        self._began: dict[int, tuple[Array, Array]] = {}  # of each side that leads: its grip, and the requests

    def let_go(self, side: int | None = None) -> None:
        """Let a side lead nothing, or both: what is still held goes on from wherever it will be."""
        if side is None:
            self._began.clear()
        else:
            self._began.pop(side, None)

    def drag(self, side: int, grip: Array, asked: Array, anew: bool) -> Dragged:
        """Take a gizmo's pose (7,). anew: its drag begins."""
        if anew or side not in self._began:
            self._began[side] = (grip, asked.copy())
            self.drags.append(asked.copy())
        grip_began, began = self._began[side]
        return Dragged(side, grip_began, grip, began)

    def end_drag(self, side: int, asked: Array | None) -> None:
        """Note that a gizmo was let go. A click is no drag."""
        self.dragged.discard(side)
        followed = self._began.pop(side, None)
        if followed is not None and self.drags and asked is not None and _near(self.drags[-1], asked):
            self.drags.pop()

    def track(self, hands: tuple[Array | None, Array | None], asked: Array | None) -> Tracked:
        """Take both hands' poses, (7,) each, None for one that leads nothing."""
        for side, hand in enumerate(hands):
            if hand is None or asked is None:
                self._began.pop(side, None)
            elif side not in self._began:
                self._began[side] = (hand, asked.copy())
        return Tracked(hands, self._began)


def _near(a: Array, b: Array) -> bool:
    """Whether two requests (2, 7) are as good as the same."""
    far = np.linalg.norm(a[:, :3] - b[:, :3], axis=1).max()
    return bool(far < _UNDONE_M) and max(map(angle_between, a[:, 3:], b[:, 3:])) < _UNDONE_RAD
