"""The QP of a tick by a dual active-set method, compiled: min 1/2 x^T H x + g^T x, bounds on x and on A x.

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
def optimality_error(H, gradient, lower, upper, A, row_lower, row_upper, x, multipliers):
    """Largest violation of the KKT conditions: feasibility (rad/s^2, Nm), signs and complementarity (relative to the
    multiplier's scale), stationarity (to the gradient's).

    A (rows, 7), row_lower and row_upper (rows,). multipliers (7 + rows,): of the bounds, then of the rows; positive at
    an upper limit, negative at a lower one.
    """
    worst = 0.0
    scale = 1.0
    for i in range(7):
        scale = max(scale, abs(gradient[i]))
    for i in range(7):
        slope = gradient[i] + multipliers[i]
        for j in range(7):
            slope += H[i, j] * x[j]
        for k in range(row_lower.shape[0]):
            slope += A[k, i] * multipliers[7 + k]
        if not math.isfinite(slope):
            return math.inf
        worst = max(worst, abs(slope) / scale)
        worst = max(worst, _limit_error(multipliers[i] / scale, x[i] - lower[i], upper[i] - x[i]))
    for k in range(row_lower.shape[0]):
        row = 0.0
        for j in range(7):
            row += A[k, j] * x[j]
        worst = max(worst, _limit_error(multipliers[7 + k] / scale, row - row_lower[k], row_upper[k] - row))
    return worst


@compiled
def _limit_error(multiplier, below, above):
    """Return the violation of a limit and of its complementarity. below, above: to its lower and its upper side."""
    if math.isnan(below) or math.isnan(above):  # a bound that is not a number
        return math.inf
    slack = above if multiplier > 0.0 else below
    return max(-below, -above, min(abs(multiplier), abs(slack)))


MOST_CHANGES = 40  # of the active limits; a problem that needs more is a general solver's
_VIOLATED = 1e-9  # rad/s^2 and Nm: rounding is no violation
_DEPENDENT = 1e-12  # of a normal's square: what is left of it beside the active ones
_STATUS = {int(status): status for status in QpStatus}
_SOLVED, _INFEASIBLE = int(QpStatus.SOLVED), int(QpStatus.INFEASIBLE)
_EXHAUSTED, _WRONG_ANSWER = int(QpStatus.ITERATIONS_EXHAUSTED), int(QpStatus.WRONG_ANSWER)

# The limits that are active now. limit: twice its number (the bounds, then the rows), 1 more for an upper one; normal:
# L^-1 n, with H = L L^T and n^T x >= b; multiplier >= 0. new: the normal that is to be taken in
ACTIVE_SET = np.dtype(
    [
        ("count", "i8"),
        ("limit", "i8", 7),
        *fields("f8", "L normal gram factor", 7, 7),
        *fields("f8", "multiplier new share step", 7),
    ]
)


class ActiveSetProgram:
    """See rtstack.control.program.Program."""

    def __init__(self, rows: int = 7) -> None:
        self._active_set, self._multipliers = np.zeros(1, ACTIVE_SET), np.zeros(7 + rows)
        free, some = np.full(7, math.inf), np.full(rows, math.inf)
        # machine code is ready now
        self.solve(np.eye(7), np.zeros(7), -free, free, np.zeros((rows, 7)), -some, some, np.zeros(7))

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, A: Array, row_lower: Array, row_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        """See Program. The iterations are how often the active limits changed."""
        status, changes = solve_active_set(
            H, gradient, lower, upper, A, row_lower, row_upper, x, self._active_set, self._multipliers
        )
        return _STATUS[status], changes


@compiled
def solve_active_set(H, gradient, lower, upper, A, row_lower, row_upper, x, active_sets, multipliers):
    """Write the solution to x, and its multipliers, see `optimality_error`.

    Return the status, as a number, and how often the active limits changed.
    """
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
        limit, violation = _most_violated(lower, upper, A, row_lower, row_upper, x)
        if limit < 0:
            break
        _normal(limit, A, active.new)
        solve_lower(active.L, 7, active.new)
        status, changes = _take_in(active, limit, violation, changes, x)
        if status != _SOLVED:
            return status, changes
    _signed(active, multipliers)
    error = optimality_error(H, gradient, lower, upper, A, row_lower, row_upper, x, multipliers)
    return (_SOLVED if error <= OPTIMALITY_TOLERANCE else _WRONG_ANSWER), changes


@compiled
def _most_violated(lower, upper, A, row_lower, row_upper, x):
    """Return the limit that x violates most, -1 for none, and by how much, rad/s^2 or the row's unit."""
    worst = _VIOLATED
    found = -1
    for i in range(7):
        if lower[i] - x[i] > worst:
            worst, found = lower[i] - x[i], 2 * i
        if x[i] - upper[i] > worst:
            worst, found = x[i] - upper[i], 2 * i + 1
    for k in range(row_lower.shape[0]):
        row = 0.0
        for j in range(7):
            row += A[k, j] * x[j]
        if row_lower[k] - row > worst:
            worst, found = row_lower[k] - row, 2 * (7 + k)
        if row - row_upper[k] > worst:
            worst, found = row - row_upper[k], 2 * (7 + k) + 1
    return found, worst


@compiled
def _normal(limit, A, out):
    """Write a limit's normal, (7,): n^T x >= b."""
    number = limit // 2
    sign = 1.0 if limit % 2 == 0 else -1.0
    for j in range(7):
        out[j] = sign * A[number - 7, j] if number >= 7 else 0.0
    if number < 7:
        out[number] = sign


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
def _signed(active, multipliers):
    """Write the multipliers by limit, positive at an upper one."""
    for i in range(multipliers.shape[0]):
        multipliers[i] = 0.0
    for a in range(active.count):
        sign = -1.0 if active.limit[a] % 2 == 0 else 1.0
        multipliers[active.limit[a] // 2] = sign * active.multiplier[a]
