"""The arm study's report: results as CSV, figures, the signals of the figures' cases, and one self-contained page."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rtstack.campaign.page import FIGURES, embedded
from rtstack.campaign.plan import PlanFile
from rtstack.campaign.statistics import proportion
from rtstack.campaign.store import Row, Store
from rtstack.studies.aim_aware.arm.claims import difference_deg, judge
from rtstack.studies.aim_aware.arm.study import ArmRun
from rtstack.studies.aim_aware.arm.worker import judged_case
from rtstack.studies.aim_aware.bands import Bands, bands
from rtstack.studies.aim_aware.figures import figure6, shares
from rtstack.studies.aim_aware.grid import Case
from rtstack.studies.aim_aware.page import kept_rows, table_lines, write_page
from rtstack.studies.platform.plan import IN_PLANE

SIGNALS = "signals.npz"
SHOWN_DEG = (-8.0, 0.0, 4.0)  # what the figure of single hits shows, of the first approach angle
PER_CENT = 100.0


def write_report(store: Store, run: ArmRun, file: PlanFile) -> Path:
    """Write results.csv, times.csv, signals.npz, figures/*.png and report.html. Returns the page's path."""
    rows = kept_rows(store, run.grid)
    folder = store.out / FIGURES
    folder.mkdir(exist_ok=True)
    found = {name: bands(rows, name) for name in run.study.tunings} if rows else {}
    captions = _figures(run, store.out, folder, found)
    return write_page(
        "arm.html", store, run, file, [embedded(folder / name, caption) for name, caption in captions],
        claims=judge(run, rows), every=rows, unseen=rows,
        table=table_lines(run.study.tunings, run.tuned.tunings), table_name="Table 2", signals=SIGNALS,
        shares=_share_lines(run, rows), asymmetry={name: difference_deg(each) for name, each in found.items()},
        stopped=Counter(row["stopped"].split(" (")[0] for row in rows if row["stopped"]),
    )  # fmt: skip


def _figures(run: ArmRun, out: Path, folder: Path, found: dict[str, Bands]) -> list[tuple[str, str]]:
    """Draw the figures; the cases of the second one are run again, and kept. Returns names and captions."""
    captions = []
    if found:
        shares(folder / "figure8.png", found, {name: column.band for name, column in run.columns.items()})
        captions.append(("figure8.png", "Figure 8: share of hits that each tuning expects, by inclination."))
    approach_deg, location_m = run.grid.plans()[0]
    impacts = [judged_case(run, Case(approach_deg, location_m, deg))[0] for deg in SHOWN_DEG]
    signals: dict[str, Any] = {impact.case.id: impact.ticks for impact in impacts}
    plan = impacts[0].plan
    np.savez_compressed(out / SIGNALS, **signals, dq_post=plan.dq_post, q_d=plan.q_d, t_d_s=plan.t_d_s)
    tuning = list(run.study.tunings)[-1]
    figure6(folder / "figure6.png", impacts, run.monitors()[tuning], IN_PLANE)
    captions.append(
        ("figure6.png", f"Figure 6(b): velocity error of joints 2, 4 and 6 and its envelope widened by e_m, tuning "
         f"({tuning}), approach {approach_deg:g} deg. Blue: used for the verdict; red: zero lies outside.")
    )  # fmt: skip
    return captions


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
