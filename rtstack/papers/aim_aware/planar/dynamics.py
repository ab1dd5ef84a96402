"""Kinematics and dynamics of the planar arm, compiled, in the links' absolute angles psi = (q1, q1+q2, q1+q2+q3)."""

import math

from hal.compilation import compiled


@compiled
def absolute(q, psi):
    """Write psi (3,) for the joints q (3,); rates likewise."""
    psi[0] = q[0]
    psi[1] = q[0] + q[1]
    psi[2] = q[0] + q[1] + q[2]


@compiled
def inertia(arm, psi, M):
    """Write M (3, 3), kg m^2, in the joints' coordinates (1). arm: a record of ARM."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(i, 3):
                for m in range(j, 3):
                    total += arm.a[k] if k == m else arm.b[k, m] * math.cos(psi[k] - psi[m])
            M[i, j] = total


@compiled
def coriolis(arm, psi, dpsi, C):
    """Write C (3, 3) in the joints' coordinates, of Christoffel's symbols: dM/dt = C + C^T."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(i, 3):
                for m in range(j, 3):
                    if k != m:
                        total += arm.b[k, m] * math.sin(psi[k] - psi[m]) * dpsi[m]
            C[i, j] = total


@compiled
def weight(arm, psi, g):
    """Write g (3,), Nm."""
    below = 0.0
    for i in range(2, -1, -1):
        below += arm.gravity * arm.G[i] * math.cos(psi[i])
        g[i] = below


@compiled
def tip(arm, psi, dpsi, x, J, dJdq):
    """Write the plate's middle x (3,): x m, y m, phi rad (0 where the last link points down), J (3, 3), J-dot q-dot."""
    x[0] = x[1] = 0.0
    x[2] = psi[2] + 0.5 * math.pi
    for j in range(3):
        J[0, j] = J[1, j] = dJdq[j] = 0.0
        J[2, j] = 1.0
    for i in range(3):
        c, s = arm.length[i] * math.cos(psi[i]), arm.length[i] * math.sin(psi[i])
        x[0] += c
        x[1] += s
        dJdq[0] -= c * dpsi[i] * dpsi[i]
        dJdq[1] -= s * dpsi[i] * dpsi[i]
        for j in range(i + 1):  # a joint turns its own link and all that follow
            J[0, j] -= s
            J[1, j] += c
