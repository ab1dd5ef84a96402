"""From a campaign's results to the numbers that the paper prints: Table II, Figure 11, and what is behind them."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from rtstack.experiments.experiment import Row
from rtstack.experiments.statistics import Interval, proportion, stratified_mean
from rtstack.papers.reference_spreading.controllers import Controller

TABLE2, FIGURE11 = "table2", "figure11"
NOMINAL = "nominal"
RICE_BOX = "rice_box"


@dataclass(frozen=True, slots=True)
class Table2Line:
    """One controller: share of successful grabs, and lift against its reference's and displacement's mean, mm."""

    controller: Controller
    success: Interval | None
    lift_mm: Interval | None


# Table II of the paper: successful grabs, %, and average maximum lifting height difference, mm
PAPER_TABLE2 = {
    Controller.NO_REFERENCE_SPREADING: (80.0, 9.81),
    Controller.NO_VELOCITY_FEEDBACK: (40.0, -17.07),
    Controller.NO_INTERIM: (85.0, 0.78),
    Controller.PROPOSED: (90.0, 6.47),
}
BASELINES = tuple(controller for controller in PAPER_TABLE2 if controller is not Controller.PROPOSED)


class Evaluation:
    """The results of a campaign, seen through the paper's eyes. conditions: under which of them.

    controllers: whose results; by default the paper's four, so that a fifth one changes nothing of what is compared.
    """

    def __init__(
        self, rows: list[Row], conditions: str = NOMINAL, controllers: Iterable[str] = tuple(PAPER_TABLE2)
    ) -> None:
        wanted = set(controllers)
        self.rows = [row for row in rows if row["conditions"] == conditions and row["controller"] in wanted]
        self.conditions = conditions

    def of(self, experiment: str, **values: object) -> list[Row]:
        """Return the rows of an experiment with these values."""
        return [
            row
            for row in self.rows
            if row["experiment"] == experiment and all(row[name] == value for name, value in values.items())
        ]

    def displacements(self) -> list[float]:
        """Return Figure 11's displacements, mm."""
        return sorted({row["displacement_mm"] for row in self.of(FIGURE11)})

    def table2(self) -> list[Table2Line]:
        """Return Table II. As in the paper the lift is taken where it was repeated: Figure 11's rice boxes.

        Without those, Table II's own trials.
        """
        repeated = self.of(FIGURE11, object=RICE_BOX) or self.of(TABLE2)
        lines = []
        for controller in PAPER_TABLE2:
            rows = self.of(TABLE2, controller=controller)
            success = proportion(sum(row["success"] for row in rows), len(rows))
            lines.append(Table2Line(controller, success, _lift(repeated, controller)))
        return lines

    def mean_force(
        self, controller: Controller, displacement_mm: float, name: str = "average_force_norm"
    ) -> Interval | None:
        """Return a point of Figure 11: the mean of (33), or of another column, over references and repetitions.

        Of successful trials: what ended early has no 200 ms around its impact.
        """
        return _by_reference(
            self.of(FIGURE11, controller=controller, displacement_mm=displacement_mm, success=True), name
        )

    def mean(self, controller: Controller, name: str) -> Interval | None:
        """Return the mean of a column over all successful trials of a controller."""
        rows = [row for row in self.rows if row["controller"] == controller and row["success"]]
        groups: dict[object, list[float]] = defaultdict(list)
        for row in rows:
            if row[name] is not None:
                groups[row["experiment"], row["reference"], place_of(row)].append(row[name])
        interval = stratified_mean(groups)
        if interval is None or interval.low is not None:
            return interval
        repeated = {key: group for key, group in groups.items() if len(group) > 1}
        return stratified_mean(repeated) or interval

    def failures(self) -> dict[str, dict[str, int]]:
        """Return how often each reason ended a trial, by controller."""
        counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
        for row in self.rows:
            if not row["success"]:
                counts[kind_of(row["failure_reason"])][row["controller"]] += 1
        return {reason: dict(by) for reason, by in sorted(counts.items())}


def place_of(row: Row) -> tuple[float, ...]:
    """Return where the object was put: mm along y and x, degrees about z; a row of before knows of y alone."""
    return row["displacement_mm"], row.get("displacement_x_mm", 0.0), row.get("yaw_deg", 0.0)


def kind_of(reason: str) -> str:
    """Return a failure without its numbers, so that equal ones count together."""
    words = reason.split(" (")[0].split(": ")
    return ": ".join(words[:3])


def _by_reference(rows: Iterable[Row], name: str) -> Interval | None:
    groups: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row[name] is not None:
            groups[row["reference"]].append(row[name])
    return stratified_mean(groups)


def _lift(rows: list[Row], controller: Controller) -> Interval | None:
    """Mean of the lift's difference to the mean of its reference and displacement, of successful trials only."""
    heights: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        if row["success"] and row["max_lift_mm"] is not None:
            heights[row["reference"], place_of(row)].append(row["max_lift_mm"])
    groups: dict[object, list[float]] = defaultdict(list)
    for row in rows:
        key = row["reference"], place_of(row)
        if row["success"] and row["controller"] == controller and row["max_lift_mm"] is not None:
            groups[key].append(row["max_lift_mm"] - sum(heights[key]) / len(heights[key]))
    return stratified_mean(groups)
