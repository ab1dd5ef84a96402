"""The QP of a tick by a dual active-set method, compiled: min 1/2 x^T H x + g^T x, bounds on x and on M x.

Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic programs, 1983. It begins at
the minimiser without limits and takes the most violated limit in, one after the other; a limit whose multiplier would
become negative is let go. One or two are active in a grab: the call of a general solver costs more than these steps.
"""

import math

import numpy as np

from hal.base.arrays import Array
from hal.compilation import compiled, fields
from rtstack.control.dense import cholesky, solve_lower, solve_lower_transposed
from rtstack.samples import QpStatus

OPTIMALITY_TOLERANCE = 1e-4  # rad/s^2 and Nm: a hundredth of what the joints can resolve


@compiled
def optimality_error(H, gradient, lower, upper, M, tau_lower, tau_upper, x, multipliers):
    """Largest violation of the KKT conditions: feasibility (rad/s^2, Nm), signs and complementarity (relative to the
    multiplier's scale), stationarity (to the gradient's).

    multipliers (14,): of the bounds, then of the torque rows; positive at an upper limit, negative at a lower one.
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


MOST_CHANGES = 40  # of the active limits; a problem that needs more is a general solver's
_VIOLATED = 1e-9  # rad/s^2 and Nm: rounding is no violation
_DEPENDENT = 1e-12  # of a normal's square: what is left of it beside the active ones
_STATUS = {int(status): status for status in QpStatus}
_SOLVED, _INFEASIBLE = int(QpStatus.SOLVED), int(QpStatus.INFEASIBLE)
_EXHAUSTED, _WRONG_ANSWER = int(QpStatus.ITERATIONS_EXHAUSTED), int(QpStatus.WRONG_ANSWER)

# The limits that are active now. limit: its kind (lower, upper, tau_lower, tau_upper) times 7 plus the joint; normal:
# L^-1 n, with H = L L^T and n^T x >= b; multiplier >= 0. new: the normal that is to be taken in. multipliers (14): as
# optimality_error has them
ACTIVE_SET = np.dtype(
    [
        ("count", "i8"),
        ("limit", "i8", 7),
        *fields("f8", "L normal gram factor", 7, 7),
        *fields("f8", "multiplier new share step", 7),
        ("multipliers", "f8", 14),
    ]
)


class ActiveSetProgram:
    """See rtstack.control.program.Program."""

    def __init__(self) -> None:
        self._active_set = np.zeros(1, ACTIVE_SET)
        free, eye = np.full(7, math.inf), np.eye(7)
        self.solve(eye, np.zeros(7), -free, free, eye, -free, free, np.zeros(7))  # machine code is ready now

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, M: Array, tau_lower: Array, tau_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        """See Program. The iterations are how often the active limits changed."""
        status, changes = solve_active_set(H, gradient, lower, upper, M, tau_lower, tau_upper, x, self._active_set)
        return _STATUS[status], changes


@compiled
def solve_active_set(H, gradient, lower, upper, M, tau_lower, tau_upper, x, active_sets):
    """Write the solution to x. Return the status, as a number, and how often the active limits changed."""
    active = active_sets[0]
    active.count = 0
    changes = 0
    if not cholesky(H, 7, active.L):
        return _WRONG_ANSWER, 0
    for i in range(7):
        x[i] = -gradient[i]
    solve_lower(active.L, 7, x)
    solve_lower_transposed(active.L, 7, x)
    while True:
        limit, violation = _most_violated(lower, upper, M, tau_lower, tau_upper, x)
        if limit < 0:
            break
        _normal(limit, M, active.new)
        solve_lower(active.L, 7, active.new)
        status, changes = _take_in(active, limit, violation, changes, x)
        if status != _SOLVED:
            return status, changes
    _signed(active)
    error = optimality_error(H, gradient, lower, upper, M, tau_lower, tau_upper, x, active.multipliers)
    return (_SOLVED if error <= OPTIMALITY_TOLERANCE else _WRONG_ANSWER), changes


@compiled
def _most_violated(lower, upper, M, tau_lower, tau_upper, x):
    """Return the limit that x violates most, -1 for none, and by how much, rad/s^2 or Nm."""
    worst = _VIOLATED
    found = -1
    for i in range(7):
        tau = 0.0
        for j in range(7):
            tau += M[i, j] * x[j]
        for kind, violation in (
            (0, lower[i] - x[i]), (1, x[i] - upper[i]), (2, tau_lower[i] - tau), (3, tau - tau_upper[i]),
        ):  # fmt: skip
            if violation > worst:
                worst = violation
                found = 7 * kind + i
    return found, worst


@compiled
def _normal(limit, M, out):
    """Write a limit's normal, (7,): n^T x >= b."""
    kind, i = limit // 7, limit % 7
    sign = 1.0 if kind % 2 == 0 else -1.0
    for j in range(7):
        out[j] = sign * M[i, j] if kind > 1 else 0.0
    if kind < 2:
        out[i] = sign


@compiled
def _take_in(active, limit, violation, changes, x):
    """Make a limit active, and let go of those that stand against it. Return the status and the changes."""
    multiplier = 0.0
    while True:
        changes += 1
        if changes > MOST_CHANGES or not _share(active):
            return _EXHAUSTED, changes
        count = active.count
        square = 0.0
        whole = 0.0
        for i in range(7):
            left = active.new[i]
            whole += left * left
            for a in range(count):
                left -= active.share[a] * active.normal[a, i]
            active.step[i] = left
            square += left * left
        first, shortest = -1, math.inf
        for a in range(count):
            if active.share[a] > 0.0 and active.multiplier[a] < shortest * active.share[a]:
                first, shortest = a, active.multiplier[a] / active.share[a]
        # seven independent normals are all that there are
        full = violation / square if count < 7 and square > _DEPENDENT * whole else math.inf
        length = min(full, shortest)
        if not length < math.inf:
            return _INFEASIBLE, changes  # nothing keeps this limit and the active ones
        for a in range(count):
            active.multiplier[a] -= length * active.share[a]
        multiplier += length
        if full < math.inf:
            solve_lower_transposed(active.L, 7, active.step)
            for i in range(7):
                x[i] += length * active.step[i]
            violation -= length * square
        if full <= shortest:
            active.limit[count] = limit
            active.multiplier[count] = multiplier
            for i in range(7):
                active.normal[count, i] = active.new[i]
            active.count = count + 1
            return _SOLVED, changes
        _let_go(active, first)


@compiled
def _share(active):
    """Write how much of each active normal is in the new one, by least squares. False where these are dependent."""
    for a in range(active.count):
        active.share[a] = 0.0
        for i in range(7):
            active.share[a] += active.normal[a, i] * active.new[i]
        for b in range(a + 1):
            active.gram[a, b] = 0.0
            for i in range(7):
                active.gram[a, b] += active.normal[a, i] * active.normal[b, i]
    if not cholesky(active.gram, active.count, active.factor):
        return False
    solve_lower(active.factor, active.count, active.share)
    solve_lower_transposed(active.factor, active.count, active.share)
    return True


@compiled
def _let_go(active, gone):
    """Remove an active limit."""
    active.count -= 1
    for a in range(gone, active.count):
        active.limit[a] = active.limit[a + 1]
        active.multiplier[a] = active.multiplier[a + 1]
        for i in range(7):
            active.normal[a, i] = active.normal[a + 1, i]


@compiled
def _signed(active):
    """Write the multipliers by row, positive at an upper limit."""
    for i in range(14):
        active.multipliers[i] = 0.0
    for a in range(active.count):
        kind, i = active.limit[a] // 7, active.limit[a] % 7
        sign = -1.0 if kind % 2 == 0 else 1.0
        active.multipliers[7 * (kind // 2) + i] = sign * active.multiplier[a]
