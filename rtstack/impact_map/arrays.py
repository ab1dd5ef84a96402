"""The problem of an impact from arrays: bodies of any kind and number, whose mass matrix and Jacobian are known."""

from collections.abc import Sequence
from itertools import groupby
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hal.base.arrays import numbers
from rtstack.impact_map.problem import Problem, slices_of
from rtstack.impact_map.scene import Contact

MOST_POINTS = 1000  # the Delassus matrix (3n, 3n) is dense: 72 MB
SYMMETRIC = 1e-9  # of the largest entry of M
ORTHONORMAL = 1e-6


def problem_from_arrays(
    M: ArrayLike, J: ArrayLike, velocity: ArrayLike, friction: ArrayLike, *, frames: ArrayLike | None = None,
    support_velocity: ArrayLike | None = None, patches: Sequence[Any] | None = None, maintained: ArrayLike = False,
) -> Problem:  # fmt: skip
    """Return the problem of nv velocities and n contact points, for `single_step`, `pressed` and `converged`.

    M (v+ - v-) = J^T lambda, with Coulomb's law between lambda and J v+ - s at each point (rtstack.impact_map.coulomb).

    Args:
        M: Mass matrix (nv, nv) of all moving bodies, motors included, symmetric and positive definite.
        J: Contact Jacobian (3n, nv): J v is the velocity m/s of the first body's point relative to the second body's,
            three rows a point: along both tangents, then along the normal, which points to the first body.
        velocity: Generalised velocity before the impact (nv,).
        friction: Coulomb's coefficient at each point (n,), or one for all.
        frames: Rotations (n, 3, 3), whose columns are tangent, tangent, normal. With them J and support_velocity are
            along the axes in which the frames are given, such as the world's.
        support_velocity: s (n, 3) m/s, of a second body whose velocity is prescribed; by default 0.
        patches: A label of each point (n), such as a number or a name: consecutive points of one label are a patch. By
            default every point is one.
        maintained: Whether points are pressed together until the sequence of impacts has ended, which matters to
            `converged` only: (n,) or one for all.

    Raises:
        ValueError: One line that names the argument, with what was expected and found.
    """
    M, J = numbers(M, "M", (None, None)), numbers(J, "J", (None, None))
    nv, n = len(M), len(J) // 3
    if nv == 0 or len(J) % 3 or not 0 < n <= MOST_POINTS:
        raise ValueError(
            f"J: expected three rows for each of 1 to {MOST_POINTS} points, found {J.shape} for M {M.shape}"
        )
    M, J, velocity = numbers(M, "M", (nv, nv)), numbers(J, "J", (3 * n, nv)), numbers(velocity, "velocity", (nv,))
    mu = numbers(np.full(n, friction) if isinstance(friction, Real) else friction, "friction", (n,))
    if mu.min() < 0.0:
        raise ValueError(f"friction: expected at least 0, found {mu.min()}")
    s = numbers(np.zeros((n, 3)) if support_velocity is None else support_velocity, "support_velocity", (n, 3))
    pressed = numbers(np.full(n, maintained) if isinstance(maintained, bool) else maintained, "maintained", (n,), bool)
    labels = range(n) if patches is None else patches
    if len(labels) != n:
        raise ValueError(f"patches: expected a label for each of {n} points, found {len(labels)}")
    groups = [(label, len(list(its))) for label, its in groupby(np.asarray(labels).tolist())]
    points = slices_of(count for _, count in groups)
    contacts = tuple(
        Contact(("the first body", f"the second of patch {label}"), float(mu[rows].max()), bool(pressed[rows].all()))
        for (label, _), rows in zip(groups, points, strict=True)
    )
    with np.errstate(over="ignore", invalid="ignore"):
        if frames is not None:
            axes = numbers(frames, "frames", (n, 3, 3)).swapaxes(1, 2)
            if not np.abs(axes @ axes.swapaxes(1, 2) - np.eye(3)).max() < ORTHONORMAL:
                raise ValueError("frames: expected rotations, whose columns are orthonormal")
            J, s = (axes @ J.reshape(n, 3, nv)).reshape(3 * n, nv), (axes @ s[..., None])[..., 0]
        if not np.abs(M - M.T).max() <= SYMMETRIC * np.abs(M).max():
            raise ValueError(f"M: expected a symmetric matrix, found differences of {np.abs(M - M.T).max():.3g}")
        try:
            copies = (array.copy() for array in (M, velocity, J, s.ravel(), mu))  # the caller's may change
            problem = Problem((), (), (), contacts, (), points, *copies)
        except np.linalg.LinAlgError:
            raise ValueError(
                "M: expected a positive definite matrix, found an eigenvalue that is not positive"
            ) from None
        products = (problem.w @ problem.w, problem.A.T @ problem.w, problem.A.T @ problem.A)
        if not all(np.isfinite(product).all() for product in products):
            raise ValueError("M, J and velocity: their products are beyond what a float holds: give them in SI units")
    return problem
