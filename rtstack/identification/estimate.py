"""Least squares with intervals that neighbouring samples, which share their errors, do not make too narrow.

The covariance is the sandwich estimator over blocks of time: what a block's residuals have in common counts once.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from hal.base.arrays import Array

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """Values (n,) and the half width of their 95 % intervals (n,); infinite where the samples say nothing."""

    value: Array
    half_width: Array


def linear(
    X: Array, y: Array, blocks: NDArray[np.int64], instruments: Array | None = None, rank: float = 3e-5
) -> Estimate:  # fmt: skip
    """Fit y (m,) = X (m, n) beta. blocks (m,): which samples belong together. instruments (m, n): what is known of each
    column without the noise that X has, where X has any. rank: the share of the largest singular value below which a
    direction of beta is left at zero."""
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    X = X / scale
    Z = X if instruments is None else instruments / np.maximum(np.linalg.norm(instruments, axis=0), 1e-300)
    sizes, directions = np.linalg.eigh(X.T @ X)
    seen = directions[:, sizes > rank**2 * sizes[-1]]
    X, Z = X @ seen, Z @ seen
    value = np.linalg.solve(Z.T @ X, Z.T @ y)
    covariance = _covariance(X, Z, y - X @ value, blocks)
    if not np.isfinite(covariance).all():
        return Estimate(seen @ value / scale, np.full(len(scale), np.inf))
    half = np.sqrt(np.einsum("ij,jk,ik->i", seen, covariance, seen))
    return Estimate(seen @ value / scale, half / scale)


def curve(
    residual: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array], scale: Array,
    blocks: NDArray[np.int64],
) -> Estimate:  # fmt: skip
    """Fit the parameters of a residual (m,), from `start`, within bounds; scale: of each parameter."""
    found = least_squares(residual, start, bounds=bounds, x_scale=scale)
    J = found.jac * scale
    return Estimate(found.x, np.sqrt(np.diag(_covariance(J, J, -found.fun, blocks))) * scale)


def _covariance(X: Array, Z: Array, left: Array, blocks: NDArray[np.int64]) -> Array:
    """Return the covariance (n, n) times the quantile's square: half widths are its roots. left (m,): residuals."""
    names, index = np.unique(blocks, return_inverse=True)
    scores = np.zeros((len(names), X.shape[1]))
    np.add.at(scores, index, Z * left[:, None])
    bread = Z.T @ X
    if len(names) <= X.shape[1] or np.linalg.cond(bread) > 1e12:
        return np.full(bread.shape, np.inf)
    inverse = np.linalg.inv(bread)
    covariance = inverse @ (scores.T @ scores) @ inverse.T * len(names) / (len(names) - X.shape[1])
    quantile = float(student.ppf(0.5 + CONFIDENCE / 2.0, len(names) - X.shape[1]))
    return quantile**2 * covariance
