"""One arm's control box: idle, moving or in reflex, which torque counts, and how many commands were lost."""

import numpy as np

from hal.base.arrays import Array
from hal.state import RobotMode
from sim_robot import reflexes
from sim_robot.plant import Plant
from sim_robot.plant_parameters import ReflexParameters

RATE_WINDOW = 100  # control_command_success_rate covers the last 100 packets (Franka Control Interface)
_ALL_ARRIVED = (1 << RATE_WINDOW) - 1
_MOVE = RobotMode.MOVE  # looked up once: an enumeration's member costs 0.1 us


class ControlBox:
    """What stands between commands and the plant for one arm (side: its index)."""

    def __init__(self, plant: Plant, side: int, tolerances: ReflexParameters) -> None:
        self.mode = RobotMode.IDLE
        self.errors = 0  # the mask of those that are latched
        self._plant, self._side, self._tolerances = plant, side, tolerances
        self._tau = np.zeros(7)  # the last torque taken, zero before the first one
        self._waiting = False  # a torque that the plant has not felt yet
        self._felt = False  # the plant has felt a command of this motion
        self._lost = 0
        self._arrived = _ALL_ARRIVED
        self._judge = reflexes.judge_of_commands(self._tau, plant.robots[side].limits)

    @property
    def success_rate(self) -> float:
        """Share of the last 100 ms that had a command; 0 when not moving."""
        if self.mode is not _MOVE:
            return 0.0
        return 1.0 if self._arrived == _ALL_ARRIVED else self._arrived.bit_count() / RATE_WINDOW

    @property
    def desires_torque(self) -> bool:
        """False while tau_J_d is zero: an idle robot's is, and so is that of torque control before the first torque."""
        return self.mode is _MOVE and self._felt

    def start(self) -> None:
        """Begin a motion: the arm is held until its first command, from which on every ms without one is lost."""
        if self.mode != RobotMode.REFLEX:
            self.mode, self._arrived = _MOVE, _ALL_ARRIVED

    def take(self, tau: Array) -> None:
        """Take a torque for the next ms, (7,), Nm. A bad one is a reflex and never reaches the plant."""
        errors = self._judge(tau)
        if errors:
            self.trip(errors)
        else:
            self._waiting = True

    def begin_millisecond(self) -> None:
        """Hand the torque that waits to the plant; where none has come, the last one stays."""
        if self._waiting:
            if self.mode is not _MOVE:
                self.mode, self._arrived = _MOVE, _ALL_ARRIVED
            self._waiting, self._lost, self._felt = False, 0, True
            self._arrived = (self._arrived << 1 | 1) & _ALL_ARRIVED
            self._apply()
        elif self.mode is _MOVE:
            self._lost += 1
            longest_ms = self._tolerances.first_command_timeout_ms
            if self._felt:
                self._arrived = self._arrived << 1 & _ALL_ARRIVED
                longest_ms = self._tolerances.communication_timeout_ms
            if self._lost >= longest_ms:
                self.trip(reflexes.COMMUNICATION)
            else:
                self._bridge()

    def _apply(self) -> None:
        self._plant.command(self._side, self._tau)

    def _bridge(self) -> None:
        """Get over a ms without a command: the last torque stays."""

    def trip(self, errors: int) -> None:
        """Latch errors: brake, hold, take nothing more until the recovery."""
        self._to(RobotMode.REFLEX)
        self.errors |= errors

    def stop(self) -> None:
        """End torque control and hold; a reflex stays latched."""
        if self.mode != RobotMode.REFLEX:
            self._to(RobotMode.IDLE)

    def lock(self) -> None:
        """Stand on the brakes, after a stop: no control until `stop` leads out of it."""
        self._to(RobotMode.OTHER)

    def recover(self) -> None:
        """Clear the latched errors. Whether their cause persists is for the caller to judge."""
        self.errors = 0
        self._to(RobotMode.IDLE)

    def _to(self, mode: RobotMode) -> None:
        # braking starts once: a second reason must not move the place where the arm holds
        if self.mode is _MOVE:
            self._plant.hold(self._side)
        self.mode = mode
        self._tau[:] = 0.0
        self._waiting, self._lost, self._felt = False, 0, False
