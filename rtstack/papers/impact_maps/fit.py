"""The linear fit of net feedback over the reference's post-impact velocity, and where it is zero (Figures 7 and 9)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


class FitError(ValueError):
    """Points that no line can be fitted to: the message says why."""


@dataclass(frozen=True, slots=True)
class ZeroFeedback:
    """net = slope (v - estimate). estimate: the experimental estimate of the post-impact velocity, m/s; low and high:
    its 95 % interval (Fieller's, from the points' own scatter; None for fewer than three points, or a slope that may
    be zero); r_squared: of the fit; n: points."""

    estimate: float
    slope: float
    r_squared: float
    low: float | None
    high: float | None
    n: int

    def error_percent(self, predicted: float) -> float:
        """Return by how much a prediction, m/s, is above the estimate, %: Tables II and III."""
        return 100.0 * (predicted / self.estimate - 1.0)


def zero_feedback(velocities: Sequence[float], net: Sequence[float]) -> ZeroFeedback:
    """Fit a line by least squares. velocities: of the references after the impact, m/s; net: (29) of each trial, m/s.

    Raises FitError.
    """
    v, a = np.asarray(velocities, dtype=float), np.asarray(net, dtype=float)
    if len(v) != len(a) or not (np.isfinite(v).all() and np.isfinite(a).all()):
        raise FitError("velocities and net feedback have to be as many finite numbers each")
    if len(np.unique(v)) < 2:
        raise FitError("a line needs two post-impact velocities at least")
    middle, mean = v.mean(), a.mean()
    spread = float(np.sum((v - middle) ** 2))
    slope = float((v - middle) @ (a - mean)) / spread
    if slope == 0.0:
        raise FitError("net feedback does not depend on the post-impact velocity")
    residuals = a - mean - slope * (v - middle)
    total = float(np.sum((a - mean) ** 2))
    left = float(residuals @ residuals)
    estimate = float(middle - mean / slope)
    low, high = _fieller(float(middle), float(mean), slope, spread, left, len(v))
    return ZeroFeedback(estimate, slope, 1.0 - left / total, low, high, len(v))


def _fieller(
    middle: float, mean: float, slope: float, spread: float, left: float, n: int
) -> tuple[float | None, float | None]:
    """Return the 95 % interval of the zero of a fitted line (Fieller 1954): all v whose fitted value may be zero."""
    if n < 3:
        return None, None
    from scipy.stats import t

    variance = left / (n - 2)
    q = float(t.ppf(0.975, n - 2)) ** 2 * variance
    # (mean + slope x)^2 <= q (1/n + x^2 / spread), x = v - middle
    a, b = slope**2 - q / spread, mean * slope
    if a <= 0.0:
        return None, None
    half = float(np.sqrt(q * (a / n + mean**2 / spread)))
    return middle + (-b - half) / a, middle + (-b + half) / a
