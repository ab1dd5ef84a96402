"""Least squares with intervals that neighbouring samples, which share their errors, do not make too narrow.

The covariance is the sandwich estimator over blocks of time: what a block's residuals have in common counts once.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

Array = NDArray[np.float64]

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """Values (n,) and the half width of their 95 % intervals (n,); infinite where the samples say nothing."""

    value: Array
    half_width: Array


def linear(X: Array, y: Array, blocks: NDArray[np.int64], instruments: Array | None = None) -> Estimate:
    """Fit y (m,) = X (m, n) beta. blocks (m,): which samples belong together.

    instruments (m, n): what is known of each column without the noise that X has, where X has any.
    """
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    X = X / scale
    Z = X if instruments is None else instruments / np.maximum(np.linalg.norm(instruments, axis=0), 1e-300)
    value = np.linalg.pinv(Z.T @ X, rcond=1e-9) @ (Z.T @ y)
    half = _half_width(X, Z, y - X @ value, blocks)
    return Estimate(value / scale, half / scale)


def curve(
    residual: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array], scale: Array,
    blocks: NDArray[np.int64],
) -> Estimate:  # fmt: skip
    """Fit the parameters of a residual (m,), from `start`, within bounds; scale: of each parameter."""
    found = least_squares(residual, start, bounds=bounds, x_scale=scale)
    J = found.jac * scale
    return Estimate(found.x, _half_width(J, J, -found.fun, blocks) * scale)


def _half_width(X: Array, Z: Array, left: Array, blocks: NDArray[np.int64]) -> Array:
    """Return the half widths, (n,). left (m,): what the fit leaves."""
    names, index = np.unique(blocks, return_inverse=True)
    scores = np.zeros((len(names), X.shape[1]))
    np.add.at(scores, index, Z * left[:, None])
    bread = Z.T @ X
    if len(names) <= X.shape[1] or np.linalg.cond(bread) > 1e12:
        return np.full(X.shape[1], np.inf)
    inverse = np.linalg.inv(bread)
    covariance = inverse @ (scores.T @ scores) @ inverse.T * len(names) / (len(names) - X.shape[1])
    quantile = float(student.ppf(0.5 + CONFIDENCE / 2.0, len(names) - X.shape[1]))
    return quantile * np.sqrt(np.diag(covariance))
