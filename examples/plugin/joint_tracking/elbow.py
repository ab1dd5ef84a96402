"""A task of the QP, in plain numpy: the elbow keeps a height, where the pad leaves it free."""

from rtstack.control.controller import ObservedArm
from rtstack.control.link_point import LinkPoint
from rtstack.control.modes import Strategy
from rtstack.control.qp_law import QpLaw
from rtstack.control.tasks import ImpedanceTask, Task
from rtstack.control.tick import CellController
from rtstack.trials.assembly import ControllerRequest

STIFFNESS = 100.0  # 1/s^2
WEIGHT = 0.1  # beside 1 of the pad's impedance


class ElbowHeight(Task):
    """height - z of the elbow, joint 4, decays as a critically damped spring."""

    def __init__(self, arm: ObservedArm, height_m: float) -> None:
        super().__init__(1, WEIGHT)
        self._elbow, self._height_m, self._dq = LinkPoint(arm, 4), height_m, arm.sample[0]["dq"]

    def update(self) -> None:
        """Write jacobian and target."""
        elbow = self._elbow
        elbow.update()
        self.jacobian[0] = elbow.jacobian[2]
        self.feed_back(self._height_m - elbow.position[2], self._dq, STIFFNESS, elbow.drift[2])


def elbow_height(request: ControllerRequest) -> CellController:
    """Return the proposed controller with this task in the place of the paper's posture task."""
    laws = [QpLaw(arm, [ImpedanceTask(arm), ElbowHeight(arm, 0.45)]) for arm in request.arms]
    return request.pair(request.modes(Strategy.PROPOSED), laws)
