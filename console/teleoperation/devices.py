"""Input devices: one interface for all. A device only says which poses are requested.

A gizmo and a tracked hand (a VR controller) give poses, a keyboard and a gamepad give deflections. Another device is
one more class here, or any program that sends poses or deflections over the WebSocket of teleoperation. `Grips` keeps
where hands and gizmos that lead the pads, and the pads, were when they began to, and the drags to undo.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from console.teleoperation.pair import Coupling, led
from console.teleoperation.quaternion import angle_between, conjugate, product, quaternion, rotation_vector
from hal.base.arrays import Array

_UNDO_DEPTH = 20  # drags
_UNDONE_M, _UNDONE_RAD = 2e-3, 5e-3  # a drag that asks for less than this is none
LONGEST_STEP_S = 0.1  # a deflection is worth this long at most: then it must be sent again

OfArms = Sequence[Array | None]  # of each arm of the cell, left before right; None: nothing is said of it


class Device(Protocol):
    """Turns what was asked before, (arms, 7), into what is asked for now."""

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """Return the new requests (arms, 7): position m, quaternion wxyz, in the world."""
        ...


@dataclass(frozen=True, slots=True)
class Dragged:
    """A grip that was moved from one pose (7,) to another since the hands were at `began` (arms, 7)."""

    side: int  # place of its arm in the arrays
    grip_began: Array
    grip: Array
    began: Array

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device."""
        turn = product(self.grip[3:], conjugate(self.grip_began[3:]))
        return led(self.began, self.side, self.grip[:3] - self.grip_began[:3], turn, coupling)


@dataclass(frozen=True, slots=True)
class Placed:
    """Hands whose poses (7,) are known: a program's, or tracked ones. None for a hand that stays."""

    poses: OfArms

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device. The poses are taken as they are: who gives poses couples them."""
        poses = asked.copy()
        for side, pose in enumerate(self.poses):
            if pose is not None:
                poses[side] = pose
        return poses


@dataclass(frozen=True, slots=True)
class Tracked:
    """Controllers in a person's hands, (7,) each, None for one that leads nothing: each pad goes as its hand has gone.

    began: of each side that leads, the hand's pose and the requests (arms, 7) when it began to.
    """

    hands: OfArms
    began: Mapping[int, tuple[Array, Array]]

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device. Two hands lead a pad each, whatever the coupling; by it one hand leads the other pad too."""
        poses = asked.copy()
        alone = sum(hand is not None for hand in self.hands) == 1
        for side, hand in enumerate(self.hands):
            if hand is not None:
                hand_began, pads_began = self.began[side]
                turn = product(hand[3:], conjugate(hand_began[3:]))
                way = hand[:3] - hand_began[:3]
                if alone and coupling is not Coupling.SEPARATE:
                    return led(pads_began, side, way, turn, coupling)
                poses[side] = led(pads_began, side, way, turn, Coupling.SEPARATE)[side]
        return poses


@dataclass(frozen=True, slots=True)
class Deflected:
    """Keys or sticks: (6,) an arm, each from -1 to 1, along the world's axes and about them, held for elapsed_s."""

    deflections: OfArms
    elapsed_s: float
    speed_m_s: float
    turn_rad_s: float

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device."""
        step_s = min(self.elapsed_s, LONGEST_STEP_S)
        for side, deflection in enumerate(self.deflections):
            if deflection is not None and deflection.any():
                bounded = np.clip(deflection, -1.0, 1.0)
                shift = bounded[:3] * self.speed_m_s * step_s
                asked = led(asked, side, shift, quaternion(bounded[3:] * self.turn_rad_s * step_s), coupling)
        return asked


@dataclass(frozen=True, slots=True)
class Led:
    """Hands that are led to a goal (arms, 7) at a speed, for elapsed_s: undo, straighten."""

    goal: Array
    elapsed_s: float
    speed_m_s: float
    turn_rad_s: float

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device. The goal is of all hands, however they are coupled."""
        step_s = min(self.elapsed_s, LONGEST_STEP_S)
        poses = asked.copy()
        for pose, goal in zip(poses, self.goal, strict=True):
            far, turned = float(np.linalg.norm(goal[:3] - pose[:3])), angle_between(goal[3:], pose[3:])
            needed_s = max(far / self.speed_m_s, turned / self.turn_rad_s)
            share = 1.0 if needed_s <= step_s else step_s / needed_s
            pose[:3] += share * (goal[:3] - pose[:3])
            pose[3:] = product(quaternion(share * rotation_vector(product(goal[3:], conjugate(pose[3:])))), pose[3:])
            pose[3:] /= np.linalg.norm(pose[3:])
        return poses


class Grips:
    """One an arm, by its place in the arrays. Not for two threads at a time. asked: the requests, (arms, 7), when
    something was said."""

    def __init__(self) -> None:
        self.dragged: set[int] = set()  # sides whose gizmo is being dragged, followed or not
        self.drags: deque[Array] = deque(maxlen=_UNDO_DEPTH)  # what was asked for before each drag that was followed
        self._began: dict[int, tuple[Array, Array]] = {}  # of each side that leads: its grip, and the requests

    def let_go(self, side: int | None = None) -> None:
        """Let a side lead nothing, or all: what is still held goes on from wherever it will be."""
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

    def track(self, hands: OfArms, asked: Array | None) -> Tracked:
        """Take the hands' poses, (7,) each, None for one that leads nothing."""
        for side, hand in enumerate(hands):
            if hand is None or asked is None:
                self._began.pop(side, None)
            elif side not in self._began:
                self._began[side] = (hand, asked.copy())
        return Tracked(hands, self._began)


def _near(a: Array, b: Array) -> bool:
    """Whether two requests (arms, 7) are as good as the same."""
    far = np.linalg.norm(a[:, :3] - b[:, :3], axis=1).max()
    return bool(far < _UNDONE_M) and max(map(angle_between, a[:, 3:], b[:, 3:])) < _UNDONE_RAD
