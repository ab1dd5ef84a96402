"""What input devices say, as requests: (arms, 7), position m and quaternion wxyz, in the world; how one leads another.

A gizmo and a tracked hand (a VR controller) give poses, a keyboard and a gamepad give deflections.
"""

from collections import deque
from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from console.teleoperation.quaternion import angle_between, conjugate, product, quaternion, rotation_vector, squared
from hal.base.arrays import Array
from rtstack.teleoperation.reach import AHEAD_M, AHEAD_RAD, UNIT_TOLERANCE

_UNDO_DEPTH = 20  # drags
_UNDONE_M, _UNDONE_RAD = 2e-3, 5e-3  # a drag that asks for less than this is none
_TOO_FAR = "the request is too far ahead of the arm: it is not followed until it comes nearer"
LONGEST_STEP_S = 0.1  # a deflection is worth this long at most: then it must be sent again
_MIRROR = np.array([1.0, -1.0, 1.0])  # the plane between the arms is y = 0

OfArms = Sequence[Array | None]  # of each arm of the cell, left before right; None: nothing is said of it


class Coupling(StrEnum):
    """What the other arm does when one is moved."""

    SEPARATE = "separate"  # nothing
    LINKED = "linked"  # both move as one body: turns are about the middle between them
    MIRRORED = "mirrored"  # the same, mirrored: hands that close on an object or open


def led(poses: Array, side: int, shift: Array, turn: Array, coupling: Coupling) -> Array:
    """Return the poses after the hand `side` was shifted by (3,), m, and turned by a quaternion, in the world."""
    moved = poses.copy()
    if coupling is Coupling.LINKED:
        centre, rotation = poses[:, :3].mean(axis=0), Rotation.from_quat(turn, scalar_first=True)
        for pose in moved:
            pose[:3] = centre + rotation.apply(pose[:3] - centre) + shift
            pose[3:] = product(turn, pose[3:])
    else:
        _move(moved[side], shift, turn)
    if coupling is Coupling.MIRRORED:
        _move(moved[1 - side], _MIRROR * shift, turn * np.array([1.0, -1.0, 1.0, -1.0]))
    moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
    return moved


def _move(pose: Array, shift: Array, turn: Array) -> None:
    pose[:3] += shift
    pose[3:] = product(turn, pose[3:])


def deflected(
    asked: Array, deflections: OfArms, elapsed_s: float, speed_m_s: float, turn_rad_s: float, coupling: Coupling
) -> Array:
    """Return the requests after keys or sticks were held for elapsed_s. deflections: (6,) an arm, each -1 to 1."""
    step_s = min(elapsed_s, LONGEST_STEP_S)
    for side, deflection in enumerate(deflections):
        if deflection is not None and deflection.any():
            bounded = np.clip(deflection, -1.0, 1.0)
            shift = bounded[:3] * speed_m_s * step_s
            asked = led(asked, side, shift, quaternion(bounded[3:] * turn_rad_s * step_s), coupling)
    return asked


def towards(asked: Array, goal: Array, elapsed_s: float, speed_m_s: float, turn_rad_s: float) -> Array:
    """Return the requests after the hands were led to a goal (arms, 7), however they are coupled, for elapsed_s."""
    step_s = min(elapsed_s, LONGEST_STEP_S)
    poses = asked.copy()
    for pose, end in zip(poses, goal, strict=True):
        far, turned = float(np.linalg.norm(end[:3] - pose[:3])), angle_between(end[3:], pose[3:])
        needed_s = max(far / speed_m_s, turned / turn_rad_s)
        share = 1.0 if needed_s <= step_s else step_s / needed_s
        pose[:3] += share * (end[:3] - pose[:3])
        pose[3:] = product(quaternion(share * rotation_vector(product(end[3:], conjugate(pose[3:])))), pose[3:])
        pose[3:] /= np.linalg.norm(pose[3:])
    return poses


def straightened(asked: Array) -> Array:
    """Return the requests, each turned to the nearest orientation that is square to the table."""
    return np.array([[*pose[:3], *squared(pose[3:])] for pose in asked])


def refusal(asked: Array, command: Array | None) -> str | None:
    """Return why requests (arms, 7) are not followed by arms whose command is `command`, None where they are."""
    if not np.isfinite(asked).all() or (np.abs(np.linalg.norm(asked[:, 3:], axis=1) - 1.0) > UNIT_TOLERANCE).any():
        return "the request is no pose"
    if command is None:
        return "the arms have not said yet where they are"
    for want, now in zip(asked, command, strict=True):
        if np.linalg.norm(want[:3] - now[:3]) > AHEAD_M or angle_between(want[3:], now[3:]) > AHEAD_RAD:
            return _TOO_FAR
    return None


def _gone(began: Array, now: Array) -> tuple[Array, Array]:
    """Return how far something has gone between two poses (7,): the way (3,), m, and the turn, a quaternion."""
    return now[:3] - began[:3], product(now[3:], conjugate(began[3:]))


class Grips:
    """One an arm, by its place in the arrays. Not for two threads at a time. asked: the requests, (arms, 7)."""

    def __init__(self) -> None:
        self.dragged: set[int] = set()  # sides whose gizmo is being dragged, followed or not
        self.drags: deque[Array] = deque(maxlen=_UNDO_DEPTH)  # what was asked for before each drag that was followed
        self._began: dict[int, tuple[Array, Array]] = {}  # of each side that leads: its grip, and the requests

    def let_go(self, side: int | None = None) -> None:
        """Let a side lead nothing, or all: what is still held goes on from wherever it will be."""
        for each in list(self._began) if side is None else (side,):
            self._began.pop(each, None)

    def drag(self, side: int, grip: Array, asked: Array, anew: bool, coupling: Coupling) -> Array:
        """Return the requests for a gizmo's pose (7,). anew: its drag begins."""
        if anew or side not in self._began:
            self._began[side] = (grip, asked.copy())
            self.drags.append(asked.copy())
        grip_began, began = self._began[side]
        return led(began, side, *_gone(grip_began, grip), coupling)

    def end_drag(self, side: int, asked: Array | None) -> None:
        """Note that a gizmo was let go. A click is no drag."""
        self.dragged.discard(side)
        followed = self._began.pop(side, None)
        if followed is not None and self.drags and asked is not None and _near(self.drags[-1], asked):
            self.drags.pop()

    def track(self, hands: OfArms, asked: Array, coupling: Coupling, anew: bool = False) -> Array:
        """Return the requests for controllers in a person's hands, (7,) each, None for one that leads nothing.

        By the coupling one hand alone leads the other pad too. anew: each hand leads from where it is now.
        """
        if anew:
            self.let_go()
        poses, alone = asked.copy(), sum(hand is not None for hand in hands) == 1
        for side, hand in enumerate(hands):
            if hand is None:
                self._began.pop(side, None)
                continue
            hand = np.concatenate((hand[:3], hand[3:] / np.linalg.norm(hand[3:])))
            hand_began, pads_began = self._began.setdefault(side, (hand, asked.copy()))
            moved = _gone(hand_began, hand)
            if alone and coupling is not Coupling.SEPARATE:
                poses = led(pads_began, side, *moved, coupling)
            else:
                poses[side] = led(pads_began, side, *moved, Coupling.SEPARATE)[side]
        return poses


def _near(a: Array, b: Array) -> bool:
    """Whether two requests (arms, 7) are as good as the same."""
    far = np.linalg.norm(a[:, :3] - b[:, :3], axis=1).max()
    return bool(far < _UNDONE_M) and max(map(angle_between, a[:, 3:], b[:, 3:])) < _UNDONE_RAD
