"""The arm study's report: claims, tables and figures, and the signals of the figures' cases as a file."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.report import Figure, Report, Section
from rtstack.experiments.statistics import proportion
from rtstack.papers.aim_aware.arm.claims import difference_deg, judge
from rtstack.papers.aim_aware.arm.study import ArmRun
from rtstack.papers.aim_aware.arm.worker import judged_case
from rtstack.papers.aim_aware.bands import bands
from rtstack.papers.aim_aware.figures import figure6, shares
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.page import cpu_s, page_values
from rtstack.papers.aim_aware.platform.plan import IN_PLANE

SIGNALS = "signals.npz"
SHOWN_DEG = (-8.0, 0.0, 4.0)  # what the figure of single hits shows, of the first approach angle
PER_CENT = 100.0


def report(run: ArmRun, results: Results) -> Report:
    """Return claims and figures; writes signals.npz, but for a preliminary report."""
    rows = results.rows
    found = {name: bands(rows, name) for name in run.study.tunings} if rows else {}
    figures = []
    if found:
        columns = {name: column.band for name, column in run.columns.items()}
        caption = "Figure 8: share of hits that each tuning expects, by inclination."
        figures.append(Figure("figure8.png", caption, partial(shares, found=found, wanted=columns)))
    if not results.preliminary:
        figures.append(_examples(run, results.out))
    more = {
        "run": run, "shares": _share_lines(run, rows),
        "asymmetry": {name: difference_deg(each) for name, each in found.items()},
        "stopped": Counter(row["stopped"].split(" (")[0] for row in rows if row["stopped"]),
    }  # fmt: skip
    return Report(
        [Section("all hits", judge(run, rows))], figures, page=("rtstack.papers.aim_aware", "arm.html"),
        values=page_values(run.study, run.tuned, rows, rows, "Table 2", SIGNALS) | more,
        summary=f"{len(rows)} simulations, {cpu_s(rows):.0f} s of a CPU",
    )  # fmt: skip


def _examples(run: ArmRun, out: Path) -> Figure:
    """Return the figure of single hits, which are run again, and kept."""
    approach_deg, location_m = run.grid.plans()[0]
    impacts = [judged_case(run, Case(approach_deg, location_m, deg))[0] for deg in SHOWN_DEG]
    signals: dict[str, Any] = {impact.case.id: impact.ticks for impact in impacts}
    plan = impacts[0].plan
    np.savez_compressed(out / SIGNALS, **signals, dq_post=plan.dq_post, q_d=plan.q_d, t_d_s=plan.t_d_s)
    tuning = list(run.study.tunings)[-1]
    caption = f"Figure 6(b): velocity error of joints 2, 4 and 6 and its envelope widened by e_m, tuning ({tuning}), "
    caption += f"approach {approach_deg:g} deg. Blue: used for the verdict; red: zero lies outside."
    parameters = run.monitors()[tuning]
    return Figure("figure6.png", caption, partial(figure6, impacts=impacts, parameters=parameters, joints=IN_PLANE))


def _share_lines(run: ArmRun, rows: Sequence[Row]) -> list[list[str]]:
    """Return a line for each inclination: the share of expected hits, with its 95 % interval, by tuning."""
    lines = []
    for deg in run.grid.inclination_deg.values():
        cells = []
        at = [row for row in rows if row["inclination_deg"] == deg]
        for name in run.monitors():
            share = proportion(sum(row[f"verdict_{name}"] == "expected" for row in at), len(at))
            if share is None or share.low is None or share.high is None:
                cells.append("-")
                continue
            low, high = PER_CENT * share.low, PER_CENT * share.high
            cells.append(f"{PER_CENT * share.mean:.0f} [{low:.0f}, {high:.0f}]")
        lines.append([f"{deg:+g}", str(len(at)), *cells])
    return lines
