"""The tasks of the QP as objects: (15) and (26) of the reference-spreading paper, and the base of tasks of your own.

A task is a term weight |jacobian ddq - target|^2 of the cost. It is updated in each tick, after the observation.
"""

import math
from collections.abc import Sequence

import numpy as np

from hal.base.arrays import Array
from hal.compilation import Step
from rtstack.control.controller import ObservedArm
from rtstack.control.impedance import impedance_target, posture_target


class Task:
    """A term weight |jacobian ddq - target|^2 of the QP's cost; ddq (7,), rad/s^2.

    A subclass writes `jacobian` and `target` in `update`, or gives compiled `steps` that do. Both run in the tick:
    they keep no memory, wait for nothing and raise nothing.

    Attributes:
        jacobian: (rows, 7), of any coordinates y: dy = jacobian dq.
        target: (rows,), the acceleration that is wanted, minus the part of ddy that ddq = 0 leaves.
        weight: (1,), 0 or more; the paper's tasks have 1.
        steps: compiled functions, each with its arguments, in the place of `update`; none: `update` is called.
    """

    steps: Sequence[Step] = ()

    def __init__(self, rows: int, weight: float = 1.0) -> None:
        """Raises ValueError where rows or weight cannot be.

        Args:
            rows: the number of coordinates, 1 or more.
            weight: of the term.
        """
        if rows < 1 or not 0.0 <= weight < math.inf:
            raise ValueError(f"a task has 1 row or more and a weight of 0 or more, not {rows} and {weight}")
        self.jacobian, self.target, self.weight = np.zeros((rows, 7)), np.zeros(rows), np.array([float(weight)])

    def update(self) -> None:
        """Write jacobian and target for the arm as it was just observed."""

    def feed_back(self, error: Array | float, dq: Array, stiffness: float, drift: Array | float = 0.0) -> None:
        """Write the target that lets an error decay as a critically damped spring: k e - 2 sqrt(k) J dq - dJ dq.

        Args:
            error: (rows,), the wanted coordinates minus the present ones.
            dq: (7,), rad/s.
            stiffness: k, 1/s^2.
            drift: (rows,), dJ dq: the acceleration of the coordinates at ddq = 0.
        """
        self.target[:] = stiffness * error - 2.0 * math.sqrt(stiffness) * (self.jacobian @ dq) - drift


class ImpedanceTask(Task):
    """(5)-(9), (22), (27): the end effector accelerates as a mass on springs and dampers would at the setpoint."""

    def __init__(self, arm: ObservedArm) -> None:
        super().__init__(6, arm.parameters.weight_impedance)
        self.jacobian = arm.workspace[0]["J"]
        self.steps = ((impedance_target, (arm.workspace, arm.setpoint, arm.control, self.target)),)


class PostureTask(Task):
    """(10), (24), (31): one joint follows its reference, where the end effector leaves it free."""

    def __init__(self, arm: ObservedArm) -> None:
        super().__init__(1, arm.parameters.weight_posture)
        joint = arm.parameters.posture_joint
        self.jacobian[0, joint] = 1.0
        self.steps = ((posture_target, (arm.sample, arm.setpoint, arm.control, joint, self.target)),)


def paper_tasks(arm: ObservedArm) -> list[Task]:
    """Return the tasks of the paper's QP for an arm: impedance of the end effector, posture of one joint."""
    return [ImpedanceTask(arm), PostureTask(arm)]
