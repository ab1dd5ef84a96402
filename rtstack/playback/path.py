"""The path of both pads in a log, and its time scaling, as references. In part compiled; no allocation in a tick.

Place s(t) in the log, by the chain rule: velocity = s' along, acceleration = s'^2 bend + s'' along. The joints are
least-squares splines of the fifth degree: measured ones have noise, and jumps in velocity at impacts. The rate ds/dt
goes up from 0 to the speed and down again along cubics of RAMP_S; s is its integral in closed form. A requested stop
brakes from the rate and acceleration of that moment, before the last ramp, and never goes past the end.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from hal.base.arrays import Array
from hal.compilation import compiled
from rtstack.control.tick import ArmController
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.model.rotation import exp_so3, multiply
from rtstack.references.recording import LARGEST_GAP_NS
from rtstack.samples import SIDES, Mode
from rtstack.trials.errors import TrialError

RAMP_S = 0.5

# speed: the rate between the ramps; the brake: time t, place s, rate and acceleration where the last ramp begins
PACE = np.dtype(
    [("speed", "f8"), ("brake_t", "f8"), ("brake_s", "f8"), ("brake_rate", "f8"), ("brake_acceleration", "f8")]
)


def pace(duration_s: float, speed: float) -> NDArray:
    """Return the pace (1,) of PACE through duration_s of a log; one that is too short for two ramps goes slower."""
    paces = np.zeros(1, PACE)
    reached = min(speed, duration_s / RAMP_S)
    paces["speed"] = paces["brake_rate"] = reached
    paces["brake_s"] = duration_s - 0.5 * reached * RAMP_S
    paces["brake_t"] = duration_s / reached
    return paces


def end_s(paces: NDArray) -> float:
    """Return when the motion is at rest, s after its start."""
    return float(paces["brake_t"][0]) + RAMP_S


@compiled
def follow(paces, t, out):
    """Write out (3,): place s in the log, ds/dt, d2s/dt2, at t s after the start; held before and after."""
    p = paces[0]
    if t < p.brake_t:
        x = min(max(t / RAMP_S, 0.0), 1.0)
        out[0] = p.speed * (RAMP_S * (x * x * x - 0.5 * x * x * x * x) + max(0.0, t - RAMP_S))
        out[1] = p.speed * x * x * (3.0 - 2.0 * x)
        out[2] = p.speed * 6.0 * x * (1.0 - x) / RAMP_S
    else:
        x = min((t - p.brake_t) / RAMP_S, 1.0)
        pull = p.brake_acceleration * RAMP_S
        x2 = x * x
        place = p.brake_rate * (x - x2 * x + 0.5 * x2 * x2) + pull * x2 * (0.5 - x * (2.0 / 3.0 - 0.25 * x))
        out[0] = p.brake_s + RAMP_S * place
        out[1] = p.brake_rate * (1.0 - x2 * (3.0 - 2.0 * x)) + pull * x * (1.0 - x) ** 2
        out[2] = (p.brake_rate * 6.0 * x * (x - 1.0) + pull * (1.0 - x) * (1.0 - 3.0 * x)) / RAMP_S


@compiled
def brake(paces, t, out):
    """Brake from the time t on; where the last ramp has begun there is nothing to do. out (3,): working memory."""
    if t >= paces[0].brake_t:
        return
    follow(paces, t, out)
    paces[0].brake_t = t
    paces[0].brake_s = out[0]
    paces[0].brake_rate = out[1]
    paces[0].brake_acceleration = out[2]


DEGREE = 5
KNOT_S = 0.06  # between two knots: what hands do is slower, and what an impact shakes is not played again
SHORTEST_S, LONGEST_S = 0.5, 120.0  # the second: 200 MB of points, a minute of preparing


@dataclass(frozen=True, slots=True)
class LoggedMotion:
    """Joints of each arm over duration_s, with two derivatives. object: by the log's metadata."""

    path: Path
    object: str
    duration_s: float
    curves: tuple[BSpline, ...]

    def joints(self, side: int, t_s: NDArray[np.floating], derivative: int = 0) -> Array:
        """Return the joints (n, 7) of an arm, rad, or their first or second derivative, at times since the start."""
        return self.curves[side](t_s, derivative)


def load_motion(path: Path, sides: Sequence[str] = SIDES) -> LoggedMotion:
    """Read the motion of a recording or any other log, of the arms of these sides. Raises TrialError with one line."""
    try:
        log = read_log(path)
        samples = [log.topic(f"/{side}/arm") for side in sides]
    except LogError as error:
        raise TrialError(str(error)) from None
    for side, records in zip(sides, samples, strict=True):
        if len(records) < 2:
            raise TrialError(f"{path}: it has no samples of the {side} arm: there is nothing to play")
    first_ns = max(int(records["t_ns"][0]) for records in samples)
    last_ns = min(_end_ns(log, side, records) for side, records in zip(sides, samples, strict=True))
    duration_s = (last_ns - first_ns) * 1e-9
    if not SHORTEST_S <= duration_s <= LONGEST_S:
        allowed = f"what is played on the arms has {SHORTEST_S:g} to {LONGEST_S:g} s"
        raise TrialError(f"{path}: its motion lasts {duration_s:.1f} s; {allowed}")
    curves = tuple(_fit(path, records, first_ns, last_ns) for records in samples)
    return LoggedMotion(path, log.metadata.get("trial", {}).get("object", ""), duration_s, curves)


def _end_ns(log: Log, side: str, records: NDArray) -> int:
    """Return when the motion ended: with the last sample, or where a controlled stop cut it short."""
    control = log.topic(f"/{side}/control")
    stopping = control["t_ns"][control["mode"] == Mode.STOPPING]
    return int(min([records["t_ns"][-1], *stopping[:1]]))


def _fit(path: Path, records: NDArray, first_ns: int, last_ns: int) -> BSpline:
    within = records[(records["t_ns"] >= first_ns) & (records["t_ns"] <= last_ns)]
    t_ns, kept = np.unique(within["t_ns"], return_index=True)
    gap_ns = int(np.max(np.diff(t_ns), initial=0))
    q = within["q"][kept]
    if gap_ns > LARGEST_GAP_NS:
        raise TrialError(f"{path}: {gap_ns * 1e-6:.0f} ms of the motion are missing: it cannot be played on the arms")
    if not np.isfinite(q).all():
        raise TrialError(f"{path}: some of its joint positions are no numbers: it cannot be played on the arms")
    t_s = (t_ns - first_ns) * 1e-9
    inner = np.linspace(t_s[0], t_s[-1], max(2, round(t_s[-1] / KNOT_S) + 1))
    knots = np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])])
    return make_lsq_spline(t_s, q, knots, DEGREE)


STEP_S = 1e-3  # of the log's time, between two stations

# One arm at one moment s of the log. position m, rotation (3, 3) in the world; along (6): derivative of the pose by s,
# bend (6): its second derivative, push and push_bend: Lambda times them, N and Nm; xi rad and its derivatives
STATION = np.dtype([
    ("position", "f8", 3), ("rotation", "f8", (3, 3)), ("along", "f8", 6), ("bend", "f8", 6), ("push", "f8", 6),
    ("push_bend", "f8", 6), ("xi", "f8"), ("xi_along", "f8"), ("xi_bend", "f8"),
])  # fmt: skip


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
