"""Small dense linear algebra for compiled code, in place: LAPACK through numba allocates at every call."""

import math

import numpy as np

from hal.compilation import compiled

# a tournament of six: each plays each once in five rounds of three
FIRST = np.array([(0, 2, 4), (0, 1, 3), (0, 1, 2), (0, 1, 2), (0, 1, 3)])
SECOND = np.array([(1, 3, 5), (2, 4, 5), (3, 5, 4), (4, 3, 5), (5, 2, 4)])


@compiled
def cholesky(A, n, L):
    """Write the lower factor of A (n, n), whose lower triangle is read. False where A is not positive definite."""
    for j in range(n):
        s = A[j, j]
        for k in range(j):
            s -= L[j, k] * L[j, k]
        if not s > 0.0:
            return False
        d = math.sqrt(s)
        L[j, j] = d
        for i in range(j + 1, n):
            t = A[i, j]
            for k in range(j):
                t -= L[i, k] * L[j, k]
            L[i, j] = t / d
    return True


@compiled
def solve_lower(L, n, x):
    """Replace x by L^-1 x."""
    for i in range(n):
        s = x[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]


@compiled
def solve_lower_transposed(L, n, x):
    """Replace x by L^-T x."""
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]


@compiled
def symmetric_eigen(A, V, turns):
    """Jacobi's method (Golub and Van Loan, 8.5): A (6, 6), symmetric, becomes diagonal, V its eigenvectors in rows.

    A sweep takes the pairs in a tournament's order, three disjoint ones a round, whose rotations need not wait for each
    other. turns (3, 2): working memory, their cosines and sines.
    """
    for i in range(6):
        for j in range(6):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        off = 0.0
        diagonal = 0.0
        for i in range(6):
            diagonal += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if not off > 1e-30 * diagonal:  # nor where one is no number
            return
        for round_ in range(5):
            for k in range(3):
                _find_turn(A, FIRST[round_, k], SECOND[round_, k], turns[k])
            for k in range(3):
                p, q = FIRST[round_, k], SECOND[round_, k]
                for m in range(k):
                    _turn_block(A, p, q, FIRST[round_, m], SECOND[round_, m], turns[k], turns[m])
                _turn_rows(V, p, q, turns[k])


@compiled
def _find_turn(A, p, q, turn):
    """Write cosine and sine of the rotation that makes A[p, q] zero, at most 45 degrees, and its own block of A."""
    wide, twice = A[q, q] - A[p, p], 2.0 * A[q, p]
    root = math.sqrt(wide * wide + twice * twice)
    cosine, tangent = 1.0, 0.0
    if root > 0.0:
        cosine = math.sqrt(0.5 + 0.5 * (abs(wide) / root))
        tangent = twice / (abs(wide) + root)
        if wide < 0.0:
            tangent = -tangent
    turn[0], turn[1] = cosine, tangent * cosine
    A[p, p] -= tangent * A[q, p]
    A[q, q] += tangent * A[q, p]
    A[p, q] = A[q, p] = 0.0


@compiled
def _turn_block(A, p, q, r, s, one, other):
    """Apply two rotations, of p with q and of r with s, to the elements of A that they share."""
    pr = one[0] * A[p, r] - one[1] * A[q, r]
    qr = one[1] * A[p, r] + one[0] * A[q, r]
    ps = one[0] * A[p, s] - one[1] * A[q, s]
    qs = one[1] * A[p, s] + one[0] * A[q, s]
    A[p, r] = A[r, p] = other[0] * pr - other[1] * ps
    A[p, s] = A[s, p] = other[1] * pr + other[0] * ps
    A[q, r] = A[r, q] = other[0] * qr - other[1] * qs
    A[q, s] = A[s, q] = other[1] * qr + other[0] * qs


@compiled
def _turn_rows(V, p, q, turn):
    for j in range(6):
        vp, vq = V[p, j], V[q, j]
        V[p, j] = turn[0] * vp - turn[1] * vq
        V[q, j] = turn[1] * vp + turn[0] * vq
