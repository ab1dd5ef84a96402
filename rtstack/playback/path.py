"""The path of both pads in a log, as points that any time scaling turns into references. In part compiled.

With the chain rule, for the place s(t) in the log: velocity = s' along, acceleration = s'^2 bend + s'' along.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.arrays import Array
from hal.compilation import compiled
from rtstack.control.tick import ArmController
from rtstack.model.rotation import exp_so3, multiply
from rtstack.playback.motion import LoggedMotion

STEP_S = 1e-3  # of the log's time, between two stations

# One arm at one moment s of the log. position m, rotation (3, 3) in the world; along (6): derivative of the pose by s,
# bend (6): its second derivative, push and push_bend: Lambda times them, N and Nm; xi rad and its derivatives
STATION = np.dtype(
    [
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("along", "f8", 6),
        ("bend", "f8", 6),
        ("push", "f8", 6),
        ("push_bend", "f8", 6),
        ("xi", "f8"),
        ("xi_along", "f8"),
        ("xi_bend", "f8"),
    ]
)


@dataclass(frozen=True, slots=True)
class ArmPath:
    """An arm along a log, n moments a STEP_S apart: stations (n,) of STATION; q, dq, ddq (n, 7) rad and its derivatives
    by s; M (n, 7, 7); gravity (n, 7) Nm; coriolis (n, 7): C dq at those dq, Nm times ds^-2."""

    stations: NDArray
    q: Array
    dq: Array
    ddq: Array
    M: Array
    gravity: Array
    coriolis: Array


def arm_path(motion: LoggedMotion, side: int, arm: ArmController) -> ArmPath:
    """Return the path of one arm, by the model of its controller."""
    s = np.arange(int(motion.duration_s / STEP_S) + 1, dtype=np.float64) * STEP_S
    q, dq, ddq = (motion.joints(side, s, order) for order in range(3))
    n = len(s)
    found = np.zeros(n, STATION)
    M, J, gravity, coriolis = np.zeros((n, 7, 7)), np.zeros((n, 6, 7)), np.zeros((n, 7)), np.zeros((n, 7))
    work, sample = arm.workspace[0], arm.sample[0]
    for k in range(n):
        sample["q"], sample["dq"] = q[k], dq[k]
        arm.observe()
        station = found[k]
        station["position"], station["rotation"], station["along"] = work["position"], work["rotation"], work["twist"]
        station["bend"] = work["dJdq"]
        M[k], J[k], gravity[k], coriolis[k] = work["M"], work["J"], work["gravity"], work["coriolis"]
    found["bend"] += np.einsum("nij,nj->ni", J, ddq)
    mobility = J @ np.linalg.solve(M, J.transpose(0, 2, 1))  # Lambda^-1 (8)
    for name, derivative in (("push", "along"), ("push_bend", "bend")):
        found[name] = np.linalg.solve(mobility, found[derivative][:, :, None])[:, :, 0]
    joint = arm.parameters.posture_joint
    found["xi"], found["xi_along"], found["xi_bend"] = q[:, joint], dq[:, joint], ddq[:, joint]
    return ArmPath(found, q, dq, ddq, M, gravity, coriolis)


@compiled
def _between(a, b, share, i):
    return a[i] + share * (b[i] - a[i])


@compiled
def write_point(stations, moment, three, turn, points):
    """Write points[0] of POINT for moment (3,): place s, ds/dt, d2s/dt2. three (3,), turn (3, 3): working memory."""
    s, rate, acceleration = moment[0], moment[1], moment[2]
    last = len(stations) - 1
    place = min(max(s / STEP_S, 0.0), float(last))
    k = min(int(place), last - 1)
    share = place - k
    ds = share * STEP_S
    a, b, point = stations[k], stations[k + 1], points[0]
    for i in range(3):
        # the acceleration along a step is taken as that of its beginning
        point.position[i] = a.position[i] + ds * (a.along[i] + 0.5 * ds * a.bend[i])
        three[i] = a.along[3 + i] + 0.5 * ds * a.bend[3 + i]
    exp_so3(three, ds, turn)
    multiply(turn, a.rotation, point.rotation)
    for i in range(6):
        point.twist[i] = rate * _between(a.along, b.along, share, i)
        push, bend = _between(a.push, b.push, share, i), _between(a.push_bend, b.push_bend, share, i)
        point.wrench_ff[i] = rate * rate * bend + acceleration * push
    point.xi = a.xi + ds * (a.xi_along + 0.5 * ds * a.xi_bend)
    along = a.xi_along + share * (b.xi_along - a.xi_along)
    point.dxi = rate * along
    point.beta = rate * rate * (a.xi_bend + share * (b.xi_bend - a.xi_bend)) + acceleration * along
