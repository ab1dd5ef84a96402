"""Whether an answer of a tick's QP is its solution: the conditions of Karush, Kuhn and Tucker."""

import math

from hal.compilation import compiled

OPTIMALITY_TOLERANCE = 1e-4  # rad/s^2 and Nm: a hundredth of what the joints can resolve


@compiled
def optimality_error(H, gradient, lower, upper, M, tau_lower, tau_upper, x, multipliers):
    """Largest violation of the KKT conditions: feasibility (rad/s^2, Nm), signs and complementarity, stationarity.

    multipliers (14,): of the bounds, then of the torque rows; positive at an upper limit, negative at a lower one.
    Stationarity counts relative to the gradient's scale, complementarity relative to the multiplier's.
    """
    worst = 0.0
    scale = 1.0
    for i in range(7):
        scale = max(scale, abs(gradient[i]))
    for i in range(7):
        tau = 0.0
        slope = gradient[i] + multipliers[i]
        for j in range(7):
            tau += M[i, j] * x[j]
            slope += H[i, j] * x[j] + M[j, i] * multipliers[7 + j]
        if not math.isfinite(slope):
            return math.inf
        worst = max(worst, abs(slope) / scale)
        worst = max(worst, lower[i] - x[i], x[i] - upper[i])
        worst = max(worst, tau_lower[i] - tau, tau - tau_upper[i])
        for multiplier, below, above in (
            (multipliers[i], x[i] - lower[i], upper[i] - x[i]),
            (multipliers[7 + i], tau - tau_lower[i], tau_upper[i] - tau),
        ):
            slack = above if multiplier > 0.0 else below
            worst = max(worst, min(abs(multiplier) / scale, abs(slack)))
    return worst
