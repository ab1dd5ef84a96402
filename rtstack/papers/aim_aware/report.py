"""The study's report: results as CSV, figures, the signals of the figures' cases, and one self-contained page."""

from pathlib import Path
from typing import Any

import numpy as np

from rtstack.campaign.page import FIGURES, embedded
from rtstack.campaign.plan import PlanFile
from rtstack.campaign.store import Store
from rtstack.studies.aim_aware.bands import Bands, bands
from rtstack.studies.aim_aware.claims import judge
from rtstack.studies.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.studies.aim_aware.figures import figure3, figure4, figure6, shares
from rtstack.studies.aim_aware.grid import Case
from rtstack.studies.aim_aware.page import kept_rows, table_lines, write_page
from rtstack.studies.aim_aware.study import StudyRun
from rtstack.studies.planar.plan import Plan

SIGNALS = "signals.npz"
# a place that the tuning has not seen; inclinations as meant, and beyond the band of the tuning that is shown
EXAMPLE = (76.0, 0.34)
SHOWN_DEG = (0.0, 2.0, 5.0)
TUNING = "a"


def write_report(store: Store, run: StudyRun, file: PlanFile) -> Path:
    """Write results.csv, times.csv, signals.npz, figures/*.png and report.html. Returns the page's path."""
    every = kept_rows(store, run.grid)
    rows = [row for row in every if not row["tuned_on"]]
    folder = store.out / FIGURES
    folder.mkdir(exist_ok=True)
    found = {name: bands(rows, name) for name in run.study.tunings} if rows else {}
    captions = _figures(run, store.out, folder, found)
    claims = judge(run, rows)
    return write_page(
        "report.html", store, run, file, [embedded(folder / name, caption) for name, caption in captions],
        claims=claims, every=every, unseen=rows, table=table_lines(run.study.tunings, run.tuned.tunings),
        table_name="Table 1", signals=SIGNALS,
    )  # fmt: skip


def _figures(run: StudyRun, out: Path, folder: Path, found: dict[str, Bands]) -> list[tuple[str, str]]:
    """Draw all figures; the cases of the first three are simulated again, and kept. Returns names and captions."""
    study, parameters = run.study, run.monitors()[TUNING]
    plan = plan_case(study, *EXAMPLE)
    rate = run.tuned.residual_rate_nm_s
    impacts = [simulate_case(study, plan, Case(*EXAMPLE, deg), rate) for deg in SHOWN_DEG]
    np.savez_compressed(out / SIGNALS, **_signals(impacts))
    figure3(folder / "figure3.png", impacts[0])
    figure4(folder / "figure4.png", impacts[1], parameters)
    figure6(folder / "figure6.png", impacts, parameters)
    of = f"approach {EXAMPLE[0]:g} deg, {EXAMPLE[1]:g} m"
    captions = [
        ("figure3.png", f"Figure 3: references before and after the impact, dashed where extended, and the arm ({of}, "
         "0 deg). After the impact y is not tracked: the arm presses."),
        ("figure4.png", "Figure 4: residual, its numerical derivative with r_b (dashed), and what the corners feel "
         f"({of}, {SHOWN_DEG[1]:+g} deg): the second corner shows in the derivative, the residual being up already."),
        ("figure6.png", f"Figure 6: velocity error and its envelope widened by e_m, tuning ({TUNING}), {of}. Blue: "
         "used for the verdict; red: zero lies outside."),
    ]  # fmt: skip
    if found:
        shares(folder / "figure7.png", found, {name: each.band for name, each in study.tunings.items()})
        captions.append(
            ("figure7.png", "Figure 7: share of impacts that each tuning expects, by inclination, over the cases that "
             "the tuning has not seen.")
        )  # fmt: skip
    return captions


def _signals(impacts: list[Impact[Plan]]) -> dict[str, Any]:
    """Return arrays by name: each case's ticks, and the references that they share."""
    signals: dict[str, Any] = {impact.case.id: impact.ticks for impact in impacts}
    plan = impacts[0].plan
    for name, reference in (("ante", plan.ante), ("post", plan.post)):
        for part, values in zip(("x", "dx", "ddx"), reference, strict=True):
            signals[f"{name}_{part}"] = values
    return signals | {"dq_post": plan.dq_post, "q_d": plan.q_d, "t_d_s": plan.t_d_s}
