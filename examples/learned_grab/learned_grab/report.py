"""The report: success by method and displacement, with 95 % intervals, and whether the learned grab is better."""

from collections.abc import Sequence

from learned_grab.demonstrations import demonstrations
from learned_grab.plan import LearningPlan
from rtstack.experiments.claims import Claim, order, shown
from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.generic import mean_figure, mean_table
from rtstack.experiments.report import Report, Section
from rtstack.experiments.statistics import Interval, proportion


def report(results: Results, plan: LearningPlan, methods: Sequence[str]) -> Report:
    """Return the report of the trials that are there."""
    learned = len(demonstrations(results.out))
    by_place = mean_table(
        "Success", results.rows, ["method", "radius_mm"], {"success": "success", "max_lift_mm": "lift, mm"}
    )
    overall = mean_table("Success over all places", results.rows, ["method"], {"success": "success"})
    figure = mean_figure(
        "learned_grab.png", "Share of grabs that hold the object until release, by its distance from where the "
        "reference was recorded, with 95 % intervals.", results.rows, "radius_mm", "method", "success", "success"
    )  # fmt: skip
    shares = {method: _share(results.rows, method) for method in methods}
    claims = [
        Claim(f"learned, {other}", f"the learned grab succeeds more often than {other.replace('_', ' ')}",
              f"{shown(shares['learned'], ' %', 0, 100.0)} against {shown(shares[other], ' %', 0, 100.0)}",
              order([(shares[other], shares["learned"])]))
        for other in methods[1:]
    ]  # fmt: skip
    about = (
        f"{learned} of {plan.demonstrations} scripted demonstrations succeeded and were learned from, at places within "
        f"{plan.radius_mm:g} mm and {plan.yaw_deg:g} degrees. The network sees where the tracker sees the object; the "
        "replay and reference spreading do not. Learned and replayed grabs go through the filter of teleoperation, "
        "reference spreading does not. All methods: the same places and seeds."
    )
    lines = [f"{method}: {shown(share, ' %', 0, 100.0)}" for method, share in shares.items()]
    return Report([Section(plan.title, claims, [overall, by_place], [figure], {}, about)], summary="\n".join(lines))


def _share(rows: Sequence[Row], method: str) -> Interval | None:
    chosen = [bool(row["success"]) for row in rows if row["method"] == method]
    return proportion(sum(chosen), len(chosen)) if chosen else None
