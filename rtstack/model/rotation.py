"""Rotations for compiled code: exp and log of SO(3), and quaternions wxyz. No allocation."""

import math

from hal.base.arrays import Array
from hal.compilation import compiled
from rtstack.safety.body import rotation_from_quaternion as rotation_from_quaternion


@compiled
def log_so3(R: Array, out: Array) -> None:
    """Write (log R)^vee, shape (3,), rad, with an angle in [0, pi]."""
    x = R[2, 1] - R[1, 2]
    y = R[0, 2] - R[2, 0]
    z = R[1, 0] - R[0, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-7:
        scale = 0.5 * angle / sine
        out[0] = scale * x
        out[1] = scale * y
        out[2] = scale * z
    elif cosine > 0.0:
        # angle / sin(angle) = 1 to machine precision
        out[0] = 0.5 * x
        out[1] = 0.5 * y
        out[2] = 0.5 * z
    else:
        # half a turn: R = 2 u u^T - I, the axis from its largest diagonal element
        k = 0
        if R[1, 1] > R[k, k]:
            k = 1
        if R[2, 2] > R[k, k]:
            k = 2
        u = math.sqrt(max(0.0, 0.5 * (R[k, k] + 1.0)))
        for i in range(3):
            out[i] = angle * (u if i == k else 0.25 * (R[i, k] + R[k, i]) / u)


@compiled
def exp_so3(w: Array, scale: float, out: Array) -> None:
    """Write exp(hat(scale w)), shape (3, 3), by Rodrigues' formula."""
    x = w[0] * scale
    y = w[1] * scale
    z = w[2] * scale
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle > 1e-4:
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / square
    else:
        a = 1.0 - square / 6.0
        b = 0.5 - square / 24.0
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[2, 2] = 1.0 - b * (x * x + y * y)
    out[0, 1] = b * x * y - a * z
    out[1, 0] = b * x * y + a * z
    out[0, 2] = b * x * z + a * y
    out[2, 0] = b * x * z - a * y
    out[1, 2] = b * y * z - a * x
    out[2, 1] = b * y * z + a * x


@compiled
def multiply(A, B, out):
    """Write A B, shapes (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@compiled
def transpose_multiply(A, B, out):
    """Write A^T B, shapes (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]


@compiled
def quaternion_from_rotation(R: Array, out: Array) -> None:
    """Write the unit quaternion wxyz of R, (4,), with the sign that is nearer to out's (Shepperd's method), so that a
    moving frame has no jump.

    Where out has zeros, w is positive, except near half a turn: there noise would decide its sign, and a direction off
    the axes decides instead.
    """
    w, x, y, z = out[0], out[1], out[2], out[3]
    t = R[0, 0] + R[1, 1] + R[2, 2]
    k = 0
    best = t
    for i in range(3):
        if R[i, i] > best:
            best = R[i, i]
            k = i + 1
    r = math.sqrt(max(0.0, 1.0 + 2.0 * best - t))
    if k == 0:
        out[0] = 0.5 * r
        s = 0.5 / r
        out[1] = s * (R[2, 1] - R[1, 2])
        out[2] = s * (R[0, 2] - R[2, 0])
        out[3] = s * (R[1, 0] - R[0, 1])
    else:
        i = k - 1
        j = (i + 1) % 3
        m = (i + 2) % 3
        s = 0.5 / r
        out[1 + i] = 0.5 * r
        out[0] = s * (R[m, j] - R[j, m])
        out[1 + j] = s * (R[j, i] + R[i, j])
        out[1 + m] = s * (R[m, i] + R[i, m])
    near = w * out[0] + x * out[1] + y * out[2] + z * out[3]
    if near == 0.0:
        near = out[0] + 0.3 * out[1] + 0.2 * out[2] + 0.1 * out[3]
    if near < 0.0:
        for i in range(4):
            out[i] = -out[i]
