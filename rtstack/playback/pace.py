"""Time scaling: which moment of a log is played now, how fast, and how that changes. Compiled; no allocation.

The rate ds/dt goes up from 0 to the speed and down to 0 again along cubics of RAMP_S each, at rest in acceleration at
both ends of a ramp; s is its integral in closed form, so that place, rate and acceleration always agree. A stop that is
asked for brakes from the rate and the acceleration of that moment, and never goes past the end: it needs less way than
is left, since it is asked for before the last ramp begins.
"""

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled

RAMP_S = 0.5
SLOWEST, FASTEST = 0.1, 4.0  # the range of the console's player; what the arms can do is asked in limits.py

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
