"""The planar study's report: claims, tables and figures, and the signals of the figures' cases as a file."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rtstack.experiments.experiment import Results
from rtstack.experiments.report import Figure, Report, Section
from rtstack.papers.aim_aware.bands import bands
from rtstack.papers.aim_aware.claims import judge
from rtstack.papers.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.papers.aim_aware.figures import figure3, figure4, figure6, shares
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.page import cpu_s, page_values
from rtstack.papers.aim_aware.planar.plan import Plan
from rtstack.papers.aim_aware.study import StudyRun

SIGNALS = "signals.npz"
# a place that the tuning has not seen; inclinations as meant, and beyond the band of the tuning that is shown
EXAMPLE = (76.0, 0.34)
SHOWN_DEG = (0.0, 2.0, 5.0)
TUNING = "a"


def report(run: StudyRun, results: Results) -> Report:
    """Return claims and figures; writes signals.npz, but for a preliminary report."""
    rows = [row for row in results.rows if not row["tuned_on"]]
    found = {name: bands(rows, name) for name in run.study.tunings} if rows else {}
    figures = [] if results.preliminary else _examples(run, results.out)
    if found:
        columns = {name: each.band for name, each in run.study.tunings.items()}
        caption = "Figure 7: share of impacts that each tuning expects, by inclination, over the cases that the tuning "
        caption += "has not seen."
        figures.append(Figure("figure7.png", caption, partial(shares, found=found, wanted=columns)))
    return Report(
        [Section("all cases", judge(run, rows))], figures, page=("rtstack.papers.aim_aware", "planar.html"),
        values=page_values(run.study, run.tuned, results.rows, rows, "Table 1", SIGNALS),
        summary=f"{len(results.rows)} simulations, {cpu_s(results.rows):.0f} s of a CPU",
    )  # fmt: skip


def _examples(run: StudyRun, out: Path) -> list[Figure]:
    """Return the figures of single cases, which are simulated again, and kept."""
    study, parameters = run.study, run.monitors()[TUNING]
    plan = plan_case(study, *EXAMPLE)
    rate = run.tuned.residual_rate_nm_s
    impacts = [simulate_case(study, plan, Case(*EXAMPLE, deg), rate) for deg in SHOWN_DEG]
    np.savez_compressed(out / SIGNALS, **_signals(impacts))
    of = f"approach {EXAMPLE[0]:g} deg, {EXAMPLE[1]:g} m"
    return [
        Figure("figure3.png", "Figure 3: references before and after the impact, dashed where extended, and the arm "
               f"({of}, 0 deg). After the impact y is not tracked: the arm presses.",
               partial(figure3, impact=impacts[0])),
        Figure("figure4.png", "Figure 4: residual, its numerical derivative with r_b (dashed), and what the corners "
               f"feel ({of}, {SHOWN_DEG[1]:+g} deg): the second corner shows in the derivative, the residual being up "
               "already.", partial(figure4, impact=impacts[1], parameters=parameters)),
        Figure("figure6.png", f"Figure 6: velocity error and its envelope widened by e_m, tuning ({TUNING}), {of}. "
               "Blue: used for the verdict; red: zero lies outside.",
               partial(figure6, impacts=impacts, parameters=parameters)),
    ]  # fmt: skip


def _signals(impacts: list[Impact[Plan]]) -> dict[str, Any]:
    """Return arrays by name: each case's ticks, and the references that they share."""
    signals: dict[str, Any] = {impact.case.id: impact.ticks for impact in impacts}
    plan = impacts[0].plan
    for name, reference in (("ante", plan.ante), ("post", plan.post)):
        for part, values in zip(("x", "dx", "ddx"), reference, strict=True):
            signals[f"{name}_{part}"] = values
    return signals | {"dq_post": plan.dq_post, "q_d": plan.q_d, "t_d_s": plan.t_d_s}
