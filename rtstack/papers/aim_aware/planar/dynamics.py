"""Dynamics of the planar arm in the links' absolute angles psi = (q1, q1+q2, q1+q2+q3), and the plant. All compiled.

The plant's links, elastic joints, motors (1) and contact are integrated by Runge and Kutta's 4th order. Its state is
(q, theta, dq, dtheta), (12,). The low-level loop makes the motors' inertia B look like B_theta (the paper's [24]):
tau_act = B/B_theta tau_d + (1 - B/B_theta) tau_t, where tau_t = K (theta - q) + D (dtheta - dq) goes to the link.
"""

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


@compiled
def contact_force(depth, rate, stiffness, exponent, damping):
    """Return F = k d^n e^(lambda d-dot), N, for depth m and its rate m/s; 0 out of contact.

    A mass m that hits at v is stopped at the depth d with k d^(n+1) / (n+1) = m (1 - e^(-lambda v) (1 + lambda v)) /
    lambda^2, and never pulled.
    """
    if depth <= 0.0:
        return 0.0
    return stiffness * depth**exponent * math.exp(damping * rate)


@compiled
def transmitted(arm, state, j):
    """Return tau_t of joint j: what a joint torque sensor sees, Nm."""
    return arm.K[j] * (state[3 + j] - state[j]) + arm.D[j] * (state[9 + j] - state[6 + j])


@compiled
def derivative(arm, surface, state, tau_d, rate, forces):
    """Write the rate (12,) of the state under the torques tau_d (3,), and the forces (2,), N, of the two corners."""
    psi1 = state[0]
    psi2 = psi1 + state[1]
    psi3 = psi2 + state[2]
    w1 = state[6]
    w2 = w1 + state[7]
    w3 = w2 + state[8]
    c1, s1 = math.cos(psi1), math.sin(psi1)
    c2, s2 = math.cos(psi2), math.sin(psi2)
    c3, s3 = math.cos(psi3), math.sin(psi3)
    t1, t2, t3 = transmitted(arm, state, 0), transmitted(arm, state, 1), transmitted(arm, state, 2)
    # generalised forces along psi: a joint's torque turns its link forwards and the one before backwards
    b12, b13, b23 = arm.b[0, 1], arm.b[0, 2], arm.b[1, 2]
    s12, s13, s23 = s1 * c2 - c1 * s2, s1 * c3 - c1 * s3, s2 * c3 - c2 * s3
    f1 = t1 - t2 - arm.gravity * arm.G[0] * c1 - b12 * s12 * w2 * w2 - b13 * s13 * w3 * w3
    f2 = t2 - t3 - arm.gravity * arm.G[1] * c2 + b12 * s12 * w1 * w1 - b23 * s23 * w3 * w3
    f3 = t3 - arm.gravity * arm.G[2] * c3 + b13 * s13 * w1 * w1 + b23 * s23 * w2 * w2
    l1, l2, l3 = arm.length[0], arm.length[1], arm.length[2]
    nx, ny = surface.normal[0], surface.normal[1]
    x = l1 * c1 + l2 * c2 + l3 * c3 - surface.point[0]
    y = l1 * s1 + l2 * s2 + l3 * s3 - surface.point[1]
    vx = -l1 * s1 * w1 - l2 * s2 * w2 - l3 * s3 * w3
    vy = l1 * c1 * w1 + l2 * c2 * w2 + l3 * c3 * w3
    for corner in range(2):
        across = arm.half_width * (2 * corner - 1)
        px, py = -s3 * across, c3 * across  # from the plate's middle to its corner
        depth = -(nx * (x + px) + ny * (y + py))
        speed = -(nx * (vx - py * w3) + ny * (vy + px * w3))
        force = contact_force(depth, speed, surface.stiffness, surface.exponent, surface.damping)
        forces[corner] = force
        if force > 0.0:
            f1 += force * l1 * (ny * c1 - nx * s1)
            f2 += force * l2 * (ny * c2 - nx * s2)
            f3 += force * (l3 * (ny * c3 - nx * s3) + ny * px - nx * py)
    # M psi-ddot = f, symmetric 3x3 by L D L^T
    m12 = b12 * (c1 * c2 + s1 * s2)
    m13 = b13 * (c1 * c3 + s1 * s3)
    m23 = b23 * (c2 * c3 + s2 * s3)
    l21, l31 = m12 / arm.a[0], m13 / arm.a[0]
    d2 = arm.a[1] - l21 * m12
    u32 = m23 - l31 * m12
    l32 = u32 / d2
    d3 = arm.a[2] - l31 * m13 - l32 * u32
    z2 = f2 - l21 * f1
    a3 = (f3 - l31 * f1 - l32 * z2) / d3
    a2 = z2 / d2 - l32 * a3
    a1 = f1 / arm.a[0] - l21 * a2 - l31 * a3
    rate[6], rate[7], rate[8] = a1, a2 - a1, a3 - a2
    for j in range(3):
        tau_t = t1 if j == 0 else (t2 if j == 1 else t3)
        shaping = arm.B[j] / arm.B_theta[j]
        tau_act = shaping * tau_d[j] + (1.0 - shaping) * tau_t
        rate[j] = state[6 + j]
        rate[3 + j] = state[9 + j]
        rate[9 + j] = (tau_act - tau_t) / arm.B[j]


@compiled
def advance(arm, surface, state, tau_d, step_s, steps, work, forces):
    """Take so many steps of step_s in place. work: (5, 12). forces (2,): of the corners, at the last step's end."""
    k1, k2, k3, k4, between = work[0], work[1], work[2], work[3], work[4]
    for _ in range(steps):
        derivative(arm, surface, state, tau_d, k1, forces)
        for i in range(12):
            between[i] = state[i] + 0.5 * step_s * k1[i]
        derivative(arm, surface, between, tau_d, k2, forces)
        for i in range(12):
            between[i] = state[i] + 0.5 * step_s * k2[i]
        derivative(arm, surface, between, tau_d, k3, forces)
        for i in range(12):
            between[i] = state[i] + step_s * k3[i]
        derivative(arm, surface, between, tau_d, k4, forces)
        for i in range(12):
            state[i] += step_s / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    derivative(arm, surface, state, tau_d, k1, forces)
