"""What the arms do about an impact that was not meant: setpoints that hold, or go back the way they came.

Torques stay the controller's and the judge's: a reaction changes what is asked for, from the tick of the verdict on.
"""

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.samples import Mode, Reaction

BRAKE_S = 0.15  # in which the setpoint's velocity goes to zero
RETREAT_M, RETREAT_S = 0.1, 0.8  # quintic: 0.23 m/s at most
HOLD_S = 1.0
LETTING_GO = 0.97  # of the feedforward wrench, each tick of a retreat: 33 ms
# so long after the first contact an object may hang between the pads: to go back would drop it
LIFTED_S = 0.5


class ReactionMotion:
    """The setpoints of a trial's reaction, both arms.

    approach (2, 3): m/s, of the pads where they meet the object; start (2, 3): m, where the reference begins: a retreat
    goes no further back than the arm has come.
    """

    def __init__(self, reaction: Reaction, approach: NDArray[np.float64], start: NDArray[np.float64]) -> None:
        self.reaction = reaction
        self._approach = approach
        self._start = start
        self.mode = Mode.IDLE
        self._began_s = -1.0
        self._from = np.zeros((2, 3))
        self._velocity = np.zeros((2, 3))
        self._way = np.zeros((2, 3))

    def begin(self, t_s: float, since_contact_s: float) -> Mode:
        """Choose the mode at the verdict. since_contact_s: negative where there was none."""
        back = self.reaction is Reaction.RETREAT and since_contact_s < LIFTED_S
        self.mode = Mode.RETREATING if back else Mode.HOLDING
        self._began_s = t_s
        return self.mode

    def take_over(self, side: int, setpoint: NDArray) -> None:
        """Start where this arm's setpoint (1,) of SETPOINT is."""
        self._from[side] = setpoint["position"][0]
        self._velocity[side] = setpoint["twist"][0, :3]
        speed = float(np.linalg.norm(self._approach[side]))
        if self.mode is Mode.RETREATING and speed > 0.0:
            direction = self._approach[side] / speed
            come = float(direction @ (self._from[side] - self._start[side]))
            self._way[side] = -min(max(come, 0.0), RETREAT_M) * direction

    def ask(self, side: int, setpoint: NDArray, t_s: float) -> None:
        """Write the setpoint of an arm at t_s."""
        share = LETTING_GO if self.mode is Mode.RETREATING else 1.0
        follow(setpoint, self._from[side], self._velocity[side], self._way[side], t_s - self._began_s, share)

    def over(self, t_s: float) -> bool:
        """Whether there is nothing more to do than to stop."""
        return t_s - self._began_s > (RETREAT_S if self.mode is Mode.RETREATING else HOLD_S)


@compiled
def follow(setpoints, origin, velocity, way, t_s, share):
    """Brake from `velocity` (3,) m/s and go the `way` (3,) m on a quintic; the rotation stays, the wrench fades."""
    setpoint = setpoints[0]
    b = min(t_s, BRAKE_S)
    x = min(t_s / RETREAT_S, 1.0)
    gone = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    speed = 30.0 * x * x * (1.0 - x) * (1.0 - x) / RETREAT_S
    for i in range(3):
        setpoint.position[i] = origin[i] + velocity[i] * (b - 0.5 * b * b / BRAKE_S) + way[i] * gone
        setpoint.twist[i] = velocity[i] * (1.0 - b / BRAKE_S) + way[i] * speed
        setpoint.twist[3 + i] = 0.0
    for i in range(6):
        setpoint.wrench_ff[i] *= share
    setpoint.dxi = 0.0
    setpoint.beta = 0.0
    setpoint.velocity_weight = 1.0
