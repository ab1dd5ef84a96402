"""Input devices: one interface for all. A device only says which poses are requested.

A gizmo and a tracked hand (a VR controller) give poses, a keyboard and a gamepad give deflections. Another device is
one more class here, or any program that sends poses or deflections over the WebSocket of teleoperation.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from console.teleoperation.pair import Coupling, led
from console.teleoperation.quaternion import angle_between, conjugate, product, quaternion, rotation_vector
from hal.arrays import Array

LONGEST_STEP_S = 0.1  # a deflection is worth this long at most: then it must be sent again


class Device(Protocol):
    """Turns what was asked before, (2, 7), into what is asked for now."""

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """Return the new requests (2, 7): position m, quaternion wxyz, in the world."""
        ...


@dataclass(frozen=True, slots=True)
class Dragged:
    """A grip that was moved from one pose (7,) to another since the hands were at `began` (2, 7)."""

    side: int
    grip_began: Array
    grip: Array
    began: Array

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device."""
        turn = product(self.grip[3:], conjugate(self.grip_began[3:]))
        return led(self.began, self.side, self.grip[:3] - self.grip_began[:3], turn, coupling)


@dataclass(frozen=True, slots=True)
class Placed:
    """Hands whose poses are known: a program's, or tracked ones. None for a hand that stays."""

    left: Array | None
    right: Array | None

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device. Both poses are taken as they are: who gives poses couples them."""
        poses = asked.copy()
        for side, pose in enumerate((self.left, self.right)):
            if pose is not None:
                poses[side] = pose
        return poses


@dataclass(frozen=True, slots=True)
class Tracked:
    """Controllers in a person's hands, (7,) each, None for one that leads nothing: each pad goes as its hand has gone.

    began: of each side that leads, the hand's pose and the requests (2, 7) when it began to.
    """

    hands: tuple[Array | None, Array | None]
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
    """Keys or sticks: (6,) a hand, each from -1 to 1, along the world's axes and about them, held for elapsed_s."""

    left: Array | None
    right: Array | None
    elapsed_s: float
    speed_m_s: float
    turn_rad_s: float

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device."""
        step_s = min(self.elapsed_s, LONGEST_STEP_S)
        for side, deflection in enumerate((self.left, self.right)):
            if deflection is not None and deflection.any():
                bounded = np.clip(deflection, -1.0, 1.0)
                shift = bounded[:3] * self.speed_m_s * step_s
                asked = led(asked, side, shift, quaternion(bounded[3:] * self.turn_rad_s * step_s), coupling)
        return asked


@dataclass(frozen=True, slots=True)
class Led:
    """Hands that are led to a goal (2, 7) at a speed, for elapsed_s: undo, straighten."""

    goal: Array
    elapsed_s: float
    speed_m_s: float
    turn_rad_s: float

    def requests(self, asked: Array, coupling: Coupling) -> Array:
        """See Device. The goal is of both hands, however they are coupled."""
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
