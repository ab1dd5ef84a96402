"""From a campaign's results to Tables II and III: a fit for each object and case, and each prediction's error."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rtstack.experiments.experiment import Row
from rtstack.impact_map import ReflectedInertia
from rtstack.papers.impact_maps.fit import FitError, ZeroFeedback, zero_feedback
from rtstack.references.motion import Motion

KINDS = tuple(ReflectedInertia)
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


@dataclass(frozen=True, slots=True)
class Cell:
    """One line of a table: an object and a case. points: (planned velocity, net feedback) of each trial that counts;
    swing: of its net feedback at the end of the window, m/s, on average; excluded: trials that failed or ended early;
    fit: None where no line can be fitted; fit_over_swing: of the net feedback's mean over its last swing; predicted:
    m/s."""

    object: str
    case: str
    points: tuple[tuple[float, float], ...]
    swing: float
    excluded: int
    fit: ZeroFeedback | None
    fit_over_swing: ZeroFeedback | None
    predicted: dict[ReflectedInertia, float]

    def error_percent(self, kind: ReflectedInertia, over_swing: bool = False) -> float | None:
        """Return what a prediction is off by, %: positive where it is too fast."""
        fit = self.fit_over_swing if over_swing else self.fit
        return None if fit is None else fit.error_percent(self.predicted[kind])

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

    def errors(self, kind: ReflectedInertia, over_swing: bool = False) -> list[float]:
        """Return the errors, %, of the lines that have one."""
        return [error for cell in self.cells if (error := cell.error_percent(kind, over_swing)) is not None]

    def average(self, kind: ReflectedInertia, over_swing: bool = False) -> float | None:
        """Return the average error, %: the bias."""
        errors = self.errors(kind, over_swing)
        return float(np.mean(errors)) if errors else None

    def absolute(self, kind: ReflectedInertia, over_swing: bool = False) -> float | None:
        """Return the average absolute error, %."""
        errors = self.errors(kind, over_swing)
        return float(np.mean(np.abs(errors))) if errors else None

    @property
    def r_squared(self) -> float | None:
        """Return the smallest R^2 of its fits."""
        return min((cell.fit.r_squared for cell in self.cells if cell.fit is not None), default=None)


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
    points = tuple((row["planned_m_s"], row["net_feedback_m_s"]) for row in good)
    predicted = {kind: rows[0][f"predicted_{kind}_m_s"] for kind in KINDS}
    swing = float(np.mean([row["swing_m_s"] for row in good])) if good else 0.0
    return Cell(
        thing,
        case,
        points,
        swing,
        len(rows) - len(good),
        _fit(good, "net_feedback_m_s"),
        _fit(good, "net_over_swing_m_s"),
        predicted,
    )


def _fit(rows: list[Row], net: str) -> ZeroFeedback | None:
    try:
        return zero_feedback([row["planned_m_s"] for row in rows], [row[net] for row in rows])
    except FitError:
        return None


def combined(both: Iterable[Table], kind: ReflectedInertia) -> float | None:
    """Return the absolute error over both tables, %."""
    errors = [error for table in both for error in table.errors(kind)]
    return float(np.mean(np.abs(errors))) if errors else None
