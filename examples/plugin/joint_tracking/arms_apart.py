"""A limit of the QP, compiled: elbows and wrists of both arms keep a distance."""

from itertools import product

from hal.base.arrays import Array
from hal.compilation import compiled
from rtstack.control.controller import ObservedArm
from rtstack.control.limits import Limit, paper_limits
from rtstack.control.link_point import LinkPoint, PointArrays, distance_row
from rtstack.control.modes import Strategy
from rtstack.control.qp_law import QpLaw
from rtstack.control.tick import CellController
from rtstack.trials.assembly import ControllerRequest

JOINTS, LEAST_M = (4, 6), 0.25
TIME_S, FASTEST = 0.05, 10.0  # time constant towards the least distance; largest acceleration asked for, m/s^2


@compiled
def keep_apart(own: PointArrays, other: PointArrays, row: int, jacobian: Array, lower: Array) -> None:
    """Bound ddot d >= -2 / T dot d - (d - least) / T^2 for the distance d of two points."""
    d, rate, drift = distance_row(own, other, jacobian[row])
    lower[row] = min(-2.0 / TIME_S * rate - (d - LEAST_M) / TIME_S**2 - drift, FASTEST)


class ArmsApart(Limit):
    """The distance between each point of an arm and each of the other one."""

    def __init__(self, arm: ObservedArm, other: ObservedArm) -> None:
        super().__init__(len(JOINTS) ** 2)
        points = [[LinkPoint(each, joint) for joint in JOINTS] for each in (arm, other)]
        pairs = enumerate(product(*points))
        rows = [(keep_apart, (a.arrays, b.arrays, k, self.jacobian, self.lower)) for k, (a, b) in pairs]
        self.steps = [point.step for side in points for point in side] + rows


def arms_apart(request: ControllerRequest) -> CellController:
    """Return the proposed controller with this limit beside the paper's."""
    pairs = zip(request.arms, reversed(request.arms), strict=True)
    laws = [QpLaw(arm, limits=[*paper_limits(arm), ArmsApart(arm, other)]) for arm, other in pairs]
    return request.pair(request.modes(Strategy.PROPOSED), laws)
