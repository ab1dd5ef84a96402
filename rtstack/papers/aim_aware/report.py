"""The planar study's report, and what both studies' have in common: claims, tables, figures, values of the page."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rtstack.experiments.claims import ClaimStatus, shown
from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.registration import judged
from rtstack.experiments.report import Figure, Report, Table
from rtstack.papers.aim_aware.claims import JUDGES, LETTERS, SHARED, Evaluation, at_contact, evaluated
from rtstack.papers.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.papers.aim_aware.figures import figure3, figure4, figure6, shares
from rtstack.papers.aim_aware.outline import Case, Column, Found, Portion
from rtstack.papers.aim_aware.study import StudyRun

SIGNALS = "signals.npz"
GROUPS = {"with the paper's letters": LETTERS, "with our tuning": ""}
PLOTTED = (
    "share of {unit} that each tuning expects, by inclination; left with the paper's epsilon and e_m, right with ours. "
    "Dashed: the paper's band; dotted: the same mirrored; shaded: always expected here."
)


def study_report(
    run: Portion[Any, Any], results: Results, rows: Sequence[Row], page: str, names: tuple[str, str],
    examples: Sequence[Figure], **values: Any,
) -> Report:  # fmt: skip
    """Return a study's report. rows: the judged ones; names: of figure and table; values: for its page."""
    figures = list(examples)
    if rows:
        groups = {title: Evaluation.of(run, rows, prefix).found for title, prefix in GROUPS.items()}
        caption = f"{names[0]}: {PLOTTED.format(unit='hits' if run.study.noisy else 'impacts')}"
        file = names[0].lower().replace(" ", "") + ".png"
        figures.append(Figure(file, caption, partial(shares, groups=groups, columns=run.study.tunings)))
    cpu_s = sum(row["cpu_s"] for row in results.rows)
    known = {
        "run": run, "study": run.study, "tuned": run.tuned, "unseen": len(rows), "table_name": names[1],
        "signals": SIGNALS, "table": table_lines(run.study.tunings, run.tuned.tunings),
        "shares": _share_table(run, rows, names[0]),
        "contacts": _contact_table(run, results.rows), "reasons": _reason_lines(run, rows), "cpu_s": cpu_s,
    }  # fmt: skip
    return Report(
        evaluated(run, rows, results.rows), figures, page=("rtstack.papers.aim_aware", page), values=known | values,
        summary=f"{len(results.rows)} simulations, {cpu_s:.0f} s of a CPU",
    )  # fmt: skip


def table_lines(columns: Mapping[str, Column], tunings: Mapping[str, Found]) -> list[list[str]]:
    """Return the lines of the paper's table: symbol, then for each tuning the paper's value and ours."""
    lines = []
    for symbol, name, unit in (
        ("m_max", "window", ""), ("m_c", "delay", ""), ("a", "decay_1_s", " 1/s"),
        ("epsilon", "configuration_rad", " rad"), ("zeta", "time_s", " s"), ("xi", "horizon_s", " s"),
        ("e_m", "velocity_rad_s", " rad/s"), ("iota", "spacing_s", " s"),
    ):  # fmt: skip
        cells = []
        for tuning, column in columns.items():
            found = getattr(tunings[tuning], name, None)
            cells += [f"{getattr(column, name):g}{unit}", "the same" if found is None else f"{found:g}{unit}"]
        lines.append([symbol, *cells])
    return lines


def _share_table(run: Portion[Any, Any], rows: Sequence[Row], figure: str) -> Table:
    """Return a line for each inclination: the share that each tuning expects, %, with its 95 % interval (Wilson)."""
    groups = [(title, Evaluation.of(run, rows, prefix)) for title, prefix in GROUPS.items()]
    lines = []
    for deg in run.grid.inclination_deg.values():
        at = [row for row in rows if row["inclination_deg"] == deg]
        cells = [shown(group.share(name, at), "", 0, 100.0) for _, group in groups for name in run.study.tunings]
        lines.append([f"{deg:+g}", str(len(at)), *cells])
    headings = ["deg", "cases", *(f"({name}) {title}" for title, _ in groups for name in run.study.tunings)]
    return Table(f"{figure} in numbers: % expected by inclination, with 95 % interval", headings, lines)


def _contact_table(run: Portion[Any, Any], rows: Sequence[Row]) -> Table | None:
    """Return the claims that hold with the paper's letters, a line for each contact of the map; None without rows."""
    lines, claims = [], [claim for claim in run.claims if claim.judge not in SHARED]
    for number, values in enumerate(run.contacts):
        here = at_contact(run, rows, number + 1, mapped=True)
        if not here:
            continue
        evaluation = Evaluation.of(run, here, LETTERS)
        found = judged(claims, JUDGES, evaluation)
        hold = [claim for claim in found if claim.verdict in (ClaimStatus.HOLDS, ClaimStatus.WITHIN)]
        bands = Counter(claim.where for claim, planned in zip(found, claims, strict=True)
                        if claim in hold and planned.judge in ("band", "mirrored band"))  # fmt: skip
        ended = [str(sum(bool(row["stopped"]) for row in here))] if run.study.noisy else []
        lines.append(
            [*(f"{value:g}" for value in values.values()), *(each.words() for each in evaluation.found.values()),
             ", ".join(bands) or "none", f"{len(hold)} of {len(found)}", *ended]
        )  # fmt: skip
    if not lines:
        return None
    names = [name.replace("_", " ") for name in run.contacts[0]]
    headings = [*names, *(f"({name}) always" for name in run.study.tunings), "bands that hold", "claims that hold"]
    headings += ["hits ended"] * run.study.noisy
    return Table("Contacts, with the paper's letters", headings, lines, numbers_from=len(headings))


def _reason_lines(run: Portion[Any, Any], rows: Sequence[Row]) -> list[list[str]]:
    """Return for each tuning how often each condition was the first that an impact did not meet."""
    lines = []
    for title, prefix in GROUPS.items():
        for name in (prefix + each for each in run.study.tunings):
            counts = Counter(row[f"reason_{name}"] for row in rows if row[f"verdict_{name}"] == "unexpected")
            text = ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in counts.most_common())
            undecided = sum(row[f"verdict_{name}"] == "none" for row in rows)
            lines.append([f"({name.removeprefix(prefix)}) {title}", text or "-", str(undecided)])
    return lines


# a place that is not in the coarse grid; inclinations: nominal, and beyond the band of the shown tuning
EXAMPLE = (76.0, 0.34)
SHOWN_DEG = (0.0, 2.0, 5.0)
TUNING = "a"


def report(run: StudyRun, results: Results) -> Report:
    """Return claims and figures; writes signals.npz unless the report is preliminary."""
    rows = [row for row in results.rows if not row["tuned_on"] and not row["contact"]]
    examples = [] if results.preliminary else _examples(run, results.out)
    return study_report(run, results, rows, "planar.html", ("Figure 7", "Table 1"), examples)


def _examples(run: StudyRun, out: Path) -> list[Figure]:
    study, parameters = run.study, run.monitors()[TUNING]
    plan = plan_case(study, *EXAMPLE)
    rate = run.tuned.residual_rate_nm_s
    impacts = [simulate_case(study, plan, Case(*EXAMPLE, deg), rate) for deg in SHOWN_DEG]
    references = {
        f"{name}_{part}": values
        for name, reference in (("ante", plan.ante), ("post", plan.post))
        for part, values in zip(("x", "dx", "ddx"), reference, strict=True)
    }
    save_signals(out, impacts, **references)
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


def save_signals(out: Path, impacts: Sequence[Impact], **more: Any) -> None:
    """Write arrays by name: each case's ticks, more, and what was meant, which they share."""
    plan, ticks = impacts[0].plan, {impact.case.id: impact.ticks for impact in impacts}
    np.savez_compressed(out / SIGNALS, **ticks, **more, dq_post=plan.dq_post, q_d=plan.q_d, t_d_s=plan.t_d_s)
