"""From a campaign's results to the numbers that the paper prints: Table II, Figure 11, and what is behind them."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rtstack.experiments.experiment import Row
from rtstack.experiments.statistics import Interval, plain_mean, proportion, stratified_mean
from rtstack.papers.reference_spreading.controllers import Controller

TABLE2, FIGURE11 = "table2", "figure11"
NOMINAL = "nominal"
RICE_BOX = "rice_box"


@dataclass(frozen=True, slots=True)
class Table2Line:
    """One controller: share of successful grabs; lift over its reference's and displacement's mean, mm, in Table II's
    trials and (repeated) of Figure 11's rice boxes.
    """

    controller: Controller
    success: Interval | None
    lift_mm: Interval | None
    repeated_lift_mm: Interval | None


AFTER_S = 0.3  # see went_on

Value = Callable[[Row], float | None]
Counted = Callable[[Row], bool]

# Table II of the paper: successful grabs, %, and average maximum lifting height difference, mm
PAPER_TABLE2 = {
    Controller.NO_REFERENCE_SPREADING: (80.0, 9.81),
    Controller.NO_VELOCITY_FEEDBACK: (40.0, -17.07),
    Controller.NO_INTERIM: (85.0, 0.78),
    Controller.PROPOSED: (90.0, 6.47),
}


class Evaluation:
    """The results of a campaign under some conditions. controllers: by default the paper's four."""

    def __init__(
        self, rows: list[Row], conditions: str = NOMINAL, controllers: Iterable[str] = tuple(PAPER_TABLE2)
    ) -> None:
        wanted = set(controllers)
        self.rows = [row for row in rows if row["conditions"] == conditions and row["controller"] in wanted]
        self.conditions = conditions

    def of(self, experiment: str, **values: object) -> list[Row]:
        return [
            row
            for row in self.rows
            if row["experiment"] == experiment and all(row[name] == value for name, value in values.items())
        ]

    def displacements(self) -> list[float]:
        return sorted({row["displacement_mm"] for row in self.of(FIGURE11)})

    def table2(self) -> list[Table2Line]:
        """Return Table II: of its own trials, and the lift as the paper takes it, of Figure 11's rice boxes."""
        own, repeated = self.of(TABLE2), self.of(FIGURE11, object=RICE_BOX)
        lines = []
        for controller in PAPER_TABLE2:
            rows = [row for row in own if row["controller"] == controller]
            success = proportion(sum(row["success"] for row in rows), len(rows))
            lines.append(Table2Line(controller, success, _lift(own, controller), _lift(repeated, controller)))
        return lines

    def mean_force(
        self, controller: Controller, displacement_mm: float, name: str = "average_force_norm",
        experiment: str = FIGURE11,
    ) -> Interval | None:  # fmt: skip
        """Return a point of Figure 11: the mean of (33), or of another column, of trials that `went_on`."""
        groups: dict[object, list[float]] = defaultdict(list)
        for row in self.of(experiment, controller=controller, displacement_mm=displacement_mm):
            if went_on(row) and row[name] is not None:
                groups[row["reference"]].append(row[name])
        return stratified_mean(groups)

    def mean(self, controller: Controller, value: str | Value, *, counted: Counted | None = None) -> Interval | None:
        """Return the mean over references of a column or function, with its t interval. counted: default `went_on`."""
        groups: dict[str, list[float]] = defaultdict(list)
        for row in self.rows:
            if row["controller"] == controller and (counted or went_on)(row):
                _gather(groups[row["reference"]], row, value)
        return plain_mean(sum(group) / len(group) for group in groups.values() if group)

    def difference(
        self, first: Controller, second: Controller, value: str | Value, *, counted: Counted | None = None,
        **wanted: object,
    ) -> Interval | None:  # fmt: skip
        """Return the mean of `first` less `second`, pair by pair, with its t interval over the references' means.

        A pair has the same experiment, reference, place and repetition, and so the same seed. counted: which trials, of
        both; by default those that `went_on`. wanted: values of columns, such as displacement_mm=30.0.
        """
        pairs: dict[tuple[object, ...], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
        for row in self.rows:
            if (counted or went_on)(row) and all(row[name] == each for name, each in wanted.items()):
                key = row["reference"], row["experiment"], place_of(row), row["repetition"]
                _gather(pairs[key][row["controller"]], row, value)
        groups: dict[object, list[float]] = defaultdict(list)
        for (reference, *_), by in pairs.items():
            if by[first] and by[second]:
                groups[reference].append(by[first][0] - by[second][0])
        return plain_mean(sum(group) / len(group) for group in groups.values())

    def failures(self) -> dict[str, dict[str, int]]:
        """Return how often each reason ended a trial, by controller."""
        counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
        for row in self.rows:
            if not row["success"]:
                counts[kind_of(row["failure_reason"])][row["controller"]] += 1
        return {reason: dict(by) for reason, by in sorted(counts.items())}


def went_on(row: Row) -> bool:
    """Whether a trial went on for AFTER_S beyond its nominal impact: all of what the measures of the impact look at.

    An object that is dropped later changes none of them, and to leave such a trial out would leave out the worst ones.
    """
    return row["ticks"] is not None and 1e-3 * row["ticks"] >= row["nominal_impact_time_s"] + AFTER_S


def every(row: Row) -> bool:
    return True


def _gather(into: list[float], row: Row, value: str | Value) -> None:
    number = row[value] if isinstance(value, str) else value(row)
    if number is not None:
        into.append(float(number))


def place_of(row: Row) -> tuple[float, ...]:
    """Return where the object was put: mm along y and x, degrees about z; a row of before knows of y alone."""
    return row["displacement_mm"], row.get("displacement_x_mm", 0.0), row.get("yaw_deg", 0.0)


def kind_of(reason: str) -> str:
    """Return a failure without its numbers, so that equal ones count together."""
    return ": ".join(reason.split(" (")[0].split(": ")[:3])


def _lift(rows: list[Row], controller: Controller) -> Interval | None:
    """Mean of the lift's difference to the mean of its reference and displacement, of successful trials only."""
    heights: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row["success"] and row["max_lift_mm"] is not None:
            heights[row["reference"], place_of(row)].append(row["max_lift_mm"])
    groups: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row["success"] and row["controller"] == controller and row["max_lift_mm"] is not None:
            same = heights[row["reference"], place_of(row)]
            groups[row["reference"]].append(row["max_lift_mm"] - sum(same) / len(same))
    return plain_mean(sum(group) / len(group) for group in groups.values())
