"""From results to Tables II and III: fits, and the predictions' errors, by robot, with t intervals over robots."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rtstack.experiments.experiment import Row
from rtstack.experiments.statistics import Interval, plain_mean
from rtstack.impact_map import ReflectedInertia
from rtstack.papers.impact_maps.prediction import MapKind
from rtstack.references.motion import Motion


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
    """Fit a line by least squares: net, (29) of each trial, over velocities after the impact, m/s. Raises FitError."""
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


NAMES = {ReflectedInertia.B_THETA: "B_theta", ReflectedInertia.B: "B", ReflectedInertia.NONE: "B = 0"}
TABLES = {Motion.HIT_AND_PUSH: "Table II", Motion.GRAB: "Table III"}
# the last two lines of Tables II and III: average and absolute error, %
PAPER = {
    Motion.HIT_AND_PUSH: {
        ReflectedInertia.B_THETA: (1.96, 3.12), ReflectedInertia.B: (5.84, 5.84), ReflectedInertia.NONE: (-1.89, 2.62),
    },
    Motion.GRAB: {
        ReflectedInertia.B_THETA: (1.27, 3.97), ReflectedInertia.B: (4.95, 6.19), ReflectedInertia.NONE: (-2.57, 5.88),
    },
}  # fmt: skip
# estimate m/s and error with B_theta, %, of each line; our objects weigh what the paper's parcel, cat food, juice do
PAPER_LINES = {
    Motion.HIT_AND_PUSH: {
        "box_060": ((0.425, 3.12), (0.587, 4.36), (0.438, 0.10)),
        "box_130": ((0.370, 4.78), (0.534, 1.82), (0.380, 2.62)),
        "box_220": ((0.333, 3.19), (0.469, 2.85), (0.364, -5.21)),
    },
    Motion.GRAB: {
        "box_060": ((0.361, 4.04), (0.505, 11.06), (0.379, 1.86)),
        "box_130": ((0.336, 1.18), (0.499, 2.66), (0.372, -4.62)),
        "box_220": ((0.316, 1.15), (0.516, -7.56), (0.323, 1.62)),
    },
}


Prediction = tuple[MapKind, ReflectedInertia]


@dataclass(frozen=True, slots=True)
class Cell:
    """One line of a table: an object and a case. points: (planned velocity, net feedback) of each trial that counts;
    swing: of its net feedback at the window's end, m/s, mean; excluded: trials that failed or ended early; fit: of
    all robots' trials; fits, over_swing: of each robot's, of net feedback or its mean over the last swing; drop: of
    its pads' lowest velocity from the single step's prediction with B_theta, %; predicted: m/s."""

    object: str
    case: str
    points: tuple[tuple[float, float], ...]
    swing: float
    excluded: int
    fit: ZeroFeedback | None
    fits: Mapping[int, ZeroFeedback]
    over_swing: Mapping[int, ZeroFeedback]
    drop: Mapping[int, float]
    predicted: Mapping[Prediction, float]

    def error_percent(self, prediction: Prediction) -> float | None:
        """Return what a prediction is off by, %, from the fit of all robots: positive where it is too fast."""
        return None if self.fit is None else self.fit.error_percent(self.predicted[prediction])

    @property
    def swing_percent(self) -> float | None:
        """Return by how much the estimate swings with the end of (29)'s window, % of it, to either side."""
        return None if self.fit is None else 100.0 * self.swing / abs(self.fit.slope * self.fit.estimate)


@dataclass(frozen=True, slots=True)
class Table:
    """Table II or III under one set of conditions."""

    conditions: str
    motion: Motion
    cells: tuple[Cell, ...]

    @property
    def robots(self) -> list[int]:
        """Return the robots that have a fit in every line that has one."""
        lines = [set(cell.fits) for cell in self.cells if cell.fits]
        return sorted(set.intersection(*lines)) if lines else []

    def errors(self, prediction: Prediction, robot: int, over_swing: bool = False) -> list[float]:
        return [
            (cell.over_swing if over_swing else cell.fits)[robot].error_percent(cell.predicted[prediction])
            for cell in self.cells
            if robot in cell.fits
        ]

    def over_robots(self, value: Callable[[int], float]) -> Interval | None:
        """Return the mean of a value of a robot, and its t interval over the robots."""
        return plain_mean(value(robot) for robot in self.robots)

    def average(self, prediction: Prediction, over_swing: bool = False) -> Interval | None:
        """Return the average error, %: the bias."""
        return self.over_robots(lambda robot: float(np.mean(self.errors(prediction, robot, over_swing))))

    def absolute(self, prediction: Prediction, over_swing: bool = False) -> Interval | None:
        """Return the average absolute error, %."""
        return self.over_robots(lambda robot: absolute(self.errors(prediction, robot, over_swing)))

    def less(self, first: Prediction, second: Prediction) -> Interval | None:
        """Return the absolute error of the first prediction less that of the second, points of a percent."""
        return self.over_robots(
            lambda robot: absolute(self.errors(first, robot)) - absolute(self.errors(second, robot))
        )

    @property
    def r_squared(self) -> float | None:
        """Return the smallest R^2 of the lines' fits over all robots."""
        return min((cell.fit.r_squared for cell in self.cells if cell.fit is not None), default=None)


def absolute(errors: Iterable[float]) -> float:
    return float(np.mean(np.abs(list(errors))))


def tables(rows: Iterable[Row]) -> list[Table]:
    """Return a table for each set of conditions and motion, in the order of the rows."""
    groups: dict[tuple[str, str], dict[tuple[str, str], list[Row]]] = {}
    for row in rows:
        group = groups.setdefault((row["conditions"], row["motion"]), {})
        group.setdefault((row["object"], row["case_name"]), []).append(row)
    return [
        Table(conditions, Motion(motion), tuple(_cell(thing, case, own) for (thing, case), own in cells.items()))
        for (conditions, motion), cells in groups.items()
    ]


def _cell(thing: str, case: str, rows: list[Row]) -> Cell:
    good = [row for row in rows if row["success"] and row["complete"]]
    nominal = rows[0][f"{MapKind.SINGLE_STEP}_{ReflectedInertia.B_THETA}_m_s"]
    lowest: dict[int, list[float]] = {}
    for row in good:
        lowest.setdefault(row["robot"], []).append(row["lowest_m_s"])
    return Cell(
        thing, case,
        points=tuple((row["planned_m_s"], row["net_feedback_m_s"]) for row in good),
        swing=float(np.mean([row["swing_m_s"] for row in good])) if good else 0.0,
        excluded=len(rows) - len(good), fit=_fit(good, "net_feedback_m_s"),
        fits=_fits(good, "net_feedback_m_s"), over_swing=_fits(good, "net_over_swing_m_s"),
        drop={robot: 100.0 * (float(np.mean(values)) / nominal - 1.0) for robot, values in lowest.items()},
        predicted={(which, kind): rows[0][f"{which}_{kind}_m_s"] for which in MapKind for kind in ReflectedInertia},
    )  # fmt: skip


def _fits(rows: list[Row], net: str) -> dict[int, ZeroFeedback]:
    robots = sorted({row["robot"] for row in rows})
    found = {robot: _fit([row for row in rows if row["robot"] == robot], net) for robot in robots}
    return {robot: fit for robot, fit in found.items() if fit is not None}


def _fit(rows: list[Row], net: str) -> ZeroFeedback | None:
    try:
        return zero_feedback([row["planned_m_s"] for row in rows], [row[net] for row in rows])
    except FitError:
        return None


def combined(both: Iterable[Table], first: Prediction, second: Prediction | None = None) -> Interval | None:
    """Return the absolute error over both tables, %; second: less that of another prediction."""
    some = list(both)
    robots = set.intersection(*(set(table.robots) for table in some)) if some else set()

    def of(prediction: Prediction, robot: int) -> float:
        return absolute(error for table in some for error in table.errors(prediction, robot))

    return plain_mean(of(first, robot) - (of(second, robot) if second is not None else 0.0) for robot in sorted(robots))
