"""The study's report: results as CSV, figures, the signals of the figures' cases, and one self-contained page."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from rtstack.campaign.plan import PlanFile
from rtstack.campaign.report import FIGURES, PAGE, embedded
from rtstack.campaign.store import Store
from rtstack.studies.aim_aware.bands import Bands, bands
from rtstack.studies.aim_aware.claims import band_words, judge, side_words
from rtstack.studies.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.studies.aim_aware.figures import figure3, figure4, figure6, figure7
from rtstack.studies.aim_aware.study import Case, StudyRun
from rtstack.studies.aim_aware.worker import Row

SIGNALS = "signals.npz"
# a place that the tuning has not seen; inclinations as meant, and beyond the band of the tuning that is shown
EXAMPLE = (76.0, 0.34)
SHOWN_DEG = (0.0, 2.0, 5.0)
TUNING = "a"


def write_report(store: Store, run: StudyRun, file: PlanFile) -> Path:
    """Write results.csv, times.csv, signals.npz, figures/*.png and report.html. Returns the page's path."""
    every = store.rows()
    wanted = {case.id for case in run.grid.cases()}
    every = [row for row in every if row["id"] in wanted]
    store.write_csv(every)
    rows = [row for row in every if not row["tuned_on"]]
    folder = store.out / FIGURES
    folder.mkdir(exist_ok=True)
    found = {name: bands(rows, name) for name in run.study.tunings} if rows else {}
    captions = _figures(run, store.out, folder, found)
    claims = judge(run, rows)
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(f"rtstack.{name}", "pages") for name in ("studies.aim_aware", "campaign")]),
        autoescape=True, undefined=StrictUndefined, trim_blocks=True,
    )  # fmt: skip
    page = environment.get_template(PAGE).render(
        run=run, study=run.study, file=file, planned=run.grid.size(), rows=every, unseen=len(rows), claims=claims,
        verdicts=Counter(str(claim.verdict) for claim in claims),
        figures=[embedded(folder / name, caption) for name, caption in captions],
        table1=_table1(run), bands=_bands(run, rows, every) if rows else [], reasons=_reasons(run, rows),
        plan_commit=store.about()["plan_commit"], commits=sorted({row["git_commit"] for row in every}),
        cpu_s=sum(row["cpu_s"] for row in every), signals=SIGNALS,
    )  # fmt: skip
    path = store.out / PAGE
    path.write_text(page, encoding="utf-8")
    return path


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
        figure7(folder / "figure7.png", found, {name: each.always_deg for name, each in study.tunings.items()})
        captions.append(
            ("figure7.png", "Figure 7: share of impacts that each tuning expects, by inclination, over the cases that "
             "the tuning has not seen.")
        )  # fmt: skip
    return captions


def _signals(impacts: list[Impact]) -> dict[str, Any]:
    """Return arrays by name: each case's ticks, and the references that they share."""
    signals: dict[str, Any] = {impact.case.id: impact.ticks for impact in impacts}
    plan = impacts[0].plan
    for name, reference in (("ante", plan.ante), ("post", plan.post)):
        for part, values in zip(("x", "dx", "ddx"), reference, strict=True):
            signals[f"{name}_{part}"] = values
    return signals | {"dq_post": plan.dq_post, "q_d": plan.q_d, "t_d_s": plan.t_d_s}


def _table1(run: StudyRun) -> list[list[str]]:
    """Return the lines of Table 1: symbol, and for each tuning the paper's value, and ours where it was found."""
    lines = []
    for symbol, name, unit in (
        ("m_max", "window", ""), ("m_c", "delay", ""), ("a", "decay_1_s", " 1/s"),
        ("epsilon", "configuration_rad", " rad"), ("zeta", "time_s", " s"), ("xi", "horizon_s", " s"),
        ("e_m", "velocity_rad_s", " rad/s"), ("iota", "spacing_s", " s"),
    ):  # fmt: skip
        cells = []
        for tuning, column in run.study.tunings.items():
            found = getattr(run.tuned.tunings[tuning], name, None)
            cells += [f"{getattr(column, name):g}{unit}", "the same" if found is None else f"{found:g}{unit}"]
        lines.append([symbol, *cells])
    return lines


def _bands(run: StudyRun, rows: list[Row], every: list[Row]) -> list[list[str]]:
    """Return a line for each tuning and each set of cases: always expected, sometimes, never."""
    lines = []
    for label, cases, prefix in (
        ("cases that the tuning has not seen", rows, ""), ("all cases", every, ""),
        ("Table 1 to the letter, unseen cases", rows, "paper_"),
    ):  # fmt: skip
        for name, column in run.study.tunings.items():
            found = bands(cases, prefix + name)
            edges = [f"{edge:+g}" if edge is not None else "nowhere" for edge in found.never]
            paper = band_words((-column.always_deg, column.always_deg))
            lines.append(
                [f"({name}) {label}", str(found.cases), paper, band_words(found.always), side_words(found.sometimes),
                 " and ".join(edges)]
            )  # fmt: skip
    return lines


def _reasons(run: StudyRun, rows: list[Row]) -> list[list[str]]:
    """Return, for each tuning, which condition was the first that unexpected impacts did not meet."""
    lines = []
    for name in run.study.tunings:
        counts = Counter(row[f"reason_{name}"] for row in rows if row[f"verdict_{name}"] == "unexpected")
        text = ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in counts.most_common())
        undecided = sum(row[f"verdict_{name}"] == "none" for row in rows)
        lines.append([f"({name})", text or "-", str(undecided)])
    return lines
