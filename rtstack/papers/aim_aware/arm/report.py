"""The arm study's report: claims, tables and figures, and the signals of the figures' cases as a file."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

from rtstack.experiments.experiment import Results
from rtstack.experiments.report import Figure, Report
from rtstack.papers.aim_aware.arm.study import ArmRun
from rtstack.papers.aim_aware.arm.worker import judged_case
from rtstack.papers.aim_aware.figures import figure6
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.platform.plan import IN_PLANE
from rtstack.papers.aim_aware.report import save_signals, study_report

SHOWN_DEG = (-8.0, 0.0, 4.0)  # inclinations in the figure of single hits, at the first approach angle


def report(run: ArmRun, results: Results) -> Report:
    """Return claims and figures; writes signals.npz unless the report is preliminary."""
    rows = [row for row in results.rows if not row["contact"]]
    examples = [] if results.preliminary else [_examples(run, results.out)]
    stopped = Counter(row["stopped"].split(" (")[0] for row in rows if row["stopped"])
    return study_report(run, results, rows, "arm.html", ("Figure 8", "Table 2"), examples, stopped=stopped)


def _examples(run: ArmRun, out: Path) -> Figure:
    approach_deg, location_m = run.grid.plans()[0]
    unlogged = replace(run, logs=None)
    impacts = [judged_case(unlogged, Case(approach_deg, location_m, deg))[0] for deg in SHOWN_DEG]
    save_signals(out, impacts)
    tuning = list(run.study.tunings)[-1]
    caption = f"Figure 6(b): velocity error of joints 2, 4 and 6 and its envelope widened by e_m, tuning ({tuning}), "
    caption += f"approach {approach_deg:g} deg. Blue: used for the verdict; red: zero lies outside."
    parameters = run.monitors()[tuning]
    return Figure("figure6.png", caption, partial(figure6, impacts=impacts, parameters=parameters, joints=IN_PLANE))
