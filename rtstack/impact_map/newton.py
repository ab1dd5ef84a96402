"""Newton's method on Coulomb's law, from a solver's answer to machine precision.

Alart and Curnier's equations: with x = lambda - rho v of each contact, it is open where x_N <= 0 (lambda = 0), closed
otherwise (v_N = 0), then sticking where |x_T| <= mu x_N (v_T = 0), else sliding: lambda_T = mu lambda_N x_T / |x_T|.
Each step solves the equations of the states that the last iterate shows: an active-set method. Redundant contacts make
the equations singular but consistent; a proximal term, 1e-9 of their size, picks the answer next to the last one.
"""

import math

import numpy as np

from hal.base.arrays import Array
from hal.compilation import compiled

STEPS = 30
PROXIMAL = 1e-9
PRECISE = 1e-14  # of the equations, SI: further steps would only stir the last digit


def refined(G: Array, b: Array, friction: Array, start: Array) -> tuple[Array, float]:
    """Return impulses (n, 3) N s near `start` that obey the law as well as the arithmetic allows: the best iterate,
    `start` included; and the largest error of the equations, m/s or N s, infinite for no number.

    G (3n, 3n) 1/kg Delassus matrix, b (3n,) m/s contact velocities before the impact, friction (n,).
    """
    try:
        best, error = _iterate(G, b, friction, np.ascontiguousarray(start).ravel())
    except (np.linalg.LinAlgError, ZeroDivisionError):  # the latter of a contact along which nothing can move
        return start, np.inf
    return best.reshape(-1, 3), error


@compiled(error_model="python")
def _iterate(G, b, friction, start):
    """Return the best of STEPS iterates, (3n,), and its error."""
    n = len(friction)
    impulses = start.copy()
    best = start
    smallest = np.inf
    x = np.empty(3 * n)
    rows = np.empty(3 * n, np.int64)
    for _ in range(STEPS):
        v = G @ impulses + b
        error = 0.0
        count = 0
        for i in range(n):
            rho = 1.0 / max(G[3 * i + 2, 3 * i + 2], 1e-12)
            for k in range(3 * i, 3 * i + 3):
                x[k] = impulses[k] - rho * v[k]
            if x[3 * i + 2] <= 0.0:
                for k in range(3 * i, 3 * i + 3):
                    error = max(error, abs(impulses[k]))
                continue
            for k in range(3):
                rows[count] = 3 * i + k
                count += 1
        K = np.empty((count, count))
        residual = np.empty(count)
        scale = 0.0
        for i in range(count):
            residual[i] = v[rows[i]]
            scale += G[rows[i], rows[i]] / count
            for j in range(count):
                K[i, j] = G[rows[i], rows[j]]
        # the open contacts carry nothing any more: what they carried leaves the residual
        for j in range(3 * n):
            if x[3 * (j // 3) + 2] <= 0.0 and impulses[j] != 0.0:
                for i in range(count):
                    residual[i] -= G[rows[i], j] * impulses[j]
        for k in range(0, count, 3):
            first = rows[k]
            error = max(error, abs(v[first + 2]))
            mu = friction[first // 3]
            reach = math.hypot(x[first], x[first + 1])
            if mu > 0.0 and reach <= mu * x[first + 2]:
                error = max(error, math.hypot(v[first], v[first + 1]))
                continue
            rho = 1.0 / G[first + 2, first + 2]
            reach = max(reach, 1e-300)
            s0 = x[first] / reach
            s1 = x[first + 1] / reach
            bound = mu * impulses[first + 2]
            residual[k] = scale * (impulses[first] - bound * s0)
            residual[k + 1] = scale * (impulses[first + 1] - bound * s1)
            error = max(error, math.hypot(residual[k], residual[k + 1]) / scale)
            # d s = (I - s s^T) (d lambda_T - rho d v_T) / |x_T|
            t00 = bound / reach * (1.0 - s0 * s0)
            t01 = -bound / reach * s0 * s1
            t11 = bound / reach * (1.0 - s1 * s1)
            for j in range(count):
                g0 = rho * K[k, j]
                g1 = rho * K[k + 1, j]
                K[k, j] = scale * (t00 * g0 + t01 * g1)
                K[k + 1, j] = scale * (t01 * g0 + t11 * g1)
            K[k, k] += scale * (1.0 - t00)
            K[k, k + 1] -= scale * t01
            K[k + 1, k] -= scale * t01
            K[k + 1, k + 1] += scale * (1.0 - t11)
            K[k, k + 2] -= scale * mu * s0
            K[k + 1, k + 2] -= scale * mu * s1
        if error < smallest:
            best, smallest = impulses.copy(), error
        if error <= PRECISE:
            break
        for i in range(count):
            K[i, i] += PROXIMAL * scale
        step = np.linalg.solve(K, residual)
        new = np.zeros(3 * n)
        for i in range(count):
            new[rows[i]] = impulses[rows[i]] - step[i]
        impulses = new
    return best, smallest
