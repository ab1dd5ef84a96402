"""The Franka Hand in the plant: one degree of freedom, its width, limited in speed and force.

The fingers are moved once a millisecond; what they press on pushes back through MuJoCo's contacts (decision 47). Not
modelled: the fingers' inertia, the gears, the motor's temperature, and the 140 N that a hand has for a moment.

An object is grasped where width - epsilon_inner < d < width + epsilon_outer (libfranka, gripper.h). As users report:
- nothing but homing works before the first homing, max_width is 0 until then (franka_ros 276, 238);
- a grasp closes, whatever the width; one that misses lets go, and so does one while something is held (libfranka 108);
- stop lets go of what is held (libfranka 18, grasp_object.cpp);
- a move that is blocked does not end for some 100 s (franka_ros 281).
Chosen here: a speed or force above the hand's is taken as the hand's, a new command aborts the former.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import isfinite

import mujoco
import numpy as np

from sim_robot.hand_parameters import FINGER_AXIS, FrankaHand
from sim_robot.plant import Plant

PERIOD_S = 1e-3
# of the difference between wanted and felt force, how much is made up for in a millisecond
FORCE_GAIN = 0.2
# a grasp has its force at this share of it, for so long
HELD_SHARE, HELD_MS = 0.9, 20
CLOSED_M = 1e-6
RELEASE_M = 1e-3  # how far fingers that let go move away from what they held


class Outcome(IntEnum):
    """How a command ended, as the gripper's port says it."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


@dataclass(slots=True)
class Order:
    """A command to a hand. outcome: None while it runs."""

    outcome: Outcome | None = None


class Hand:
    """The hand of an arm, by its index. Units m, m/s, N. `advance` is called once a ms, after the plant's."""

    def __init__(self, plant: Plant, side: int, parameters: FrankaHand) -> None:
        self.parameters, self._plant = parameters, plant
        self.width, self.max_width = parameters.start_width, 0.0
        self._bodies = plant.finger_bodies[side]
        self._hand_body = plant.pad_bodies[side]
        self._geoms = [int(plant.model.body_geomadr[body]) for body in self._bodies]
        # a width that closes by dw squeezes two springs by dw / 2 each
        self._closing_per_n = 2.0 * FORCE_GAIN / parameters.stiffness
        self._order: Order | None = None
        self._window: tuple[float, float] | None = None  # m, of the grasp that runs, or holds
        self._homing = self._holding = False
        self._letting_go: Outcome | None = None  # how the order ends once nothing is touched any more
        self._goal, self._speed, self._force = self.width, parameters.max_speed, parameters.max_force
        self._ordered_tick = self._held_ms = 0
        self._wrench = np.zeros(6)

    @property
    def ticks(self) -> int:
        """The robot's time, ms."""
        return self._plant.ticks

    @property
    def busy(self) -> bool:
        return self._order is not None

    @property
    def is_grasped(self) -> bool:
        """True while something of the grasp's width is held."""
        return self._holding and self._in_window

    @property
    def _in_window(self) -> bool:
        return self._window is not None and self._window[0] < self.width < self._window[1]

    def homing(self) -> Order:
        """Open as far as the fingers go, which is then max_width."""
        order = self._begin(self.parameters.max_width, self.parameters.homing_speed, self.parameters.max_force)
        self._homing = True
        return order

    def move(self, width: float, speed: float) -> Order:
        """Go to a width. FAIL before homing, for a width outside 0 and max_width, a speed that is not positive."""
        if not (self._possible(width) and isfinite(speed) and speed > 0.0):
            return Order(Outcome.FAIL)  # nothing changes of the one that runs
        return self._begin(width, speed, self.parameters.max_force)

    def grasp(self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float) -> Order:
        """Close until `force` is felt, and hold; UNSUCCESSFUL where the width is another one then. FAIL as `move`."""
        good = self._possible(width) and min(speed, force) > 0.0 and min(epsilon_inner, epsilon_outer) >= 0.0
        if not (good and all(map(isfinite, (speed, force, epsilon_inner, epsilon_outer)))):
            return Order(Outcome.FAIL)
        held = self.is_grasped
        order = self._begin(0.0, speed, force)
        self._window = width - epsilon_inner, width + epsilon_outer
        if held:
            self._let_go(Outcome.UNSUCCESSFUL)
        return order

    def stop(self) -> Order:
        """End what runs, which is ABORTED, and let go of what is held."""
        gripping = self._window is not None
        order = self._begin(self.width, self.parameters.max_speed, self.parameters.max_force)
        if gripping:
            self._let_go(Outcome.SUCCESS)
        else:
            self._finish(Outcome.SUCCESS)
        return order

    def _possible(self, width: float) -> bool:
        return self.max_width > 0.0 and isfinite(width) and 0.0 <= width <= self.max_width

    def _begin(self, goal: float, speed: float, force: float) -> Order:
        self._finish(Outcome.ABORTED)
        self._order = Order()
        self._homing = self._holding = False
        self._letting_go = None
        self._window, self._goal = None, goal
        self._speed, self._force = min(speed, self.parameters.max_speed), min(force, self.parameters.max_force)
        self._ordered_tick, self._held_ms = self._plant.ticks, 0
        return self._order

    def _finish(self, outcome: Outcome) -> None:
        if self._order is not None:
            self._order.outcome, self._order = outcome, None

    def _let_go(self, outcome: Outcome) -> None:
        self._holding, self._letting_go, self._window = False, outcome, None
        self._speed = self.parameters.max_speed
        self._goal = min(self.width + RELEASE_M, self.parameters.max_width)

    def felt(self) -> tuple[float, float]:
        """Return the force that pushes each finger open, N."""
        data, plant = self._plant.data, self._plant
        forces = [0.0, 0.0]
        axis = data.xmat[self._hand_body].reshape(3, 3) @ FINGER_AXIS
        pairs = data.contact.geom
        for finger, geom in enumerate(self._geoms):
            outwards = (1.0 - 2.0 * finger) * axis
            for index in np.flatnonzero((pairs == geom).any(axis=1)):
                mujoco.mj_contactForce(plant.model, data, int(index), self._wrench)
                push = data.contact.frame[index].reshape(3, 3).T @ self._wrench[:3]  # on the contact's second geom
                forces[finger] += float(outwards @ push) * (1.0 if pairs[index, 1] == geom else -1.0)
        return forces[0], forces[1]

    def advance(self) -> None:
        """Move the fingers for the ms that has passed, and see whether the command has ended."""
        if not self.busy and not self._holding:
            return
        one, other = self.felt()
        mean, squeeze = (one + other) / 2.0, min(one, other)
        if self._letting_go is not None and mean > 0.0:
            self._goal = min(self.width + RELEASE_M, self.parameters.max_width)
        self._step(mean)
        if self._order is not None:
            self._judge(squeeze)

    def _step(self, force: float) -> None:
        furthest = self._speed * PERIOD_S
        step = min(max(self._goal - self.width, -furthest), furthest)
        if force > 0.0:  # something is between the fingers
            step = max(step, -self._closing_per_n * (self._force - force))
        elif force < 0.0:  # around them
            step = min(step, self._closing_per_n * (self._force + force))
        self.width = min(max(self.width + step, 0.0), self.parameters.max_width)
        for finger, body in enumerate(self._bodies):
            self._plant.model.body_pos[body] = self.parameters.finger_position(finger, self.width)

    def _judge(self, squeeze: float) -> None:
        there = abs(self._goal - self.width) < CLOSED_M
        if self._letting_go is not None:
            if there:
                self._finish(self._letting_go)
            return
        if self._window is not None:
            self._held_ms = self._held_ms + 1 if squeeze >= HELD_SHARE * self._force else 0
            if self._held_ms >= HELD_MS or self.width <= CLOSED_M:
                if self._in_window:
                    self._holding = True
                    self._finish(Outcome.SUCCESS)
                else:
                    self._let_go(Outcome.UNSUCCESSFUL)
                return
        elif there:
            if self._homing:
                self.max_width = self.parameters.max_width
            self._finish(Outcome.SUCCESS)
            return
        if (self._plant.ticks - self._ordered_tick) * PERIOD_S >= self.parameters.move_timeout_s:
            self._let_go(Outcome.UNSUCCESSFUL)
