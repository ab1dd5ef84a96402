"""Coulomb's law by another way than the map's solvers: De Saxce's change of variable, and a projected gradient.

Acary, Cadoux, Lemarechal, Malick, "A formulation of the linear discrete Coulomb friction problem via convex
optimization", 2011: with s_i = mu_i |v_T,i| given, impulses minimise 1/2 l^T G l + (b + mu s)^T l over the cones, and
s is then taken from the velocities that follow, until it stays.
"""

import numpy as np

from hal.compilation import compiled

ROUNDS, STEPS = 300, 20_000
SAME = 1e-13  # m/s


def cone_velocity(M, J, velocity, friction, s):
    """Return the generalised velocity (nv,) after the impact; J (3n, nv), friction (n,), s (3n,): of the supports."""
    Minv_Jt = np.linalg.solve(M, J.T)
    G, b = np.ascontiguousarray(J @ Minv_Jt), J @ velocity - s
    impulses = _solve(G, b, np.ascontiguousarray(friction), 1.0 / np.linalg.eigvalsh(G)[-1])
    return velocity + Minv_Jt @ impulses


@compiled
def _solve(G, b, friction, step):
    n = len(friction)
    impulses, slip = np.zeros(3 * n), np.zeros(n)
    for _ in range(ROUNDS):
        shifted = b.copy()
        for i in range(n):
            shifted[3 * i + 2] += friction[i] * slip[i]
        last, ahead, t = impulses.copy(), impulses.copy(), 1.0
        for _k in range(STEPS):
            impulses = ahead - step * (G @ ahead + shifted)
            for i in range(n):
                _project(impulses[3 * i : 3 * i + 3], friction[i])
            moved = impulses - last
            if np.abs(G @ moved).max() < 1e-3 * SAME:
                break
            if (ahead - impulses) @ moved > 0.0:  # against the momentum: begin it anew
                t = 1.0
            following = (1.0 + np.sqrt(1.0 + 4.0 * t * t)) / 2.0
            ahead = impulses + (t - 1.0) / following * moved
            last, t = impulses, following
        v = G @ impulses + b
        change = 0.0
        for i in range(n):
            now = np.hypot(v[3 * i], v[3 * i + 1])
            change = max(change, abs(now - slip[i]))
            slip[i] = now
        if change < SAME:
            break
    return impulses


@compiled
def _project(x, mu):
    """Project (3,) onto |x_T| <= mu x_N."""
    size = np.hypot(x[0], x[1])
    if size <= mu * x[2]:
        return
    if mu * size <= -x[2]:
        x[0] = x[1] = x[2] = 0.0
        return
    normal = (mu * size + x[2]) / (1.0 + mu * mu)
    x[0] *= mu * normal / size
    x[1] *= mu * normal / size
    x[2] = normal
