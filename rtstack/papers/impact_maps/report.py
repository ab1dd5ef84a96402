"""The report of a validation campaign: the paper's tables, with ours beside them, and its figures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path

import matplotlib as mpl
import numpy as np

from rtstack.control.tick import ArmController
from rtstack.experiments.claims import shown
from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.report import PAGE, Figure, Report, Section, Table
from rtstack.figures.style import STYLE, new_figure, save
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.papers.impact_maps.claims import judge_claims
from rtstack.papers.impact_maps.evaluation import NAMES, PAPER, PAPER_LINES, TABLES, Cell, tables
from rtstack.papers.impact_maps.evaluation import Table as Fitted
from rtstack.papers.impact_maps.feedback import FeedbackSignal, feedback_signal
from rtstack.papers.impact_maps.plan import DIRECTIONS, PlannedReference, ValidationPlan
from rtstack.papers.impact_maps.prediction import MapKind
from rtstack.references.motion import Motion
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.review import log_columns

# the sets of the paper's figures 6 and 7 (cat food, case 2) and 8 and 9 (juice, case 3): object, index of the case
SHOWN = {Motion.HIT_AND_PUSH: ("box_130", 1), Motion.GRAB: ("box_220", 2)}
NUMBERS = {Motion.HIT_AND_PUSH: (6, 7), Motion.GRAB: (8, 9)}


def report(
    plan: ValidationPlan, description: CellDescription, results: Results,
    refused: Mapping[PlannedReference, str],
) -> Report:  # fmt: skip
    """Return the report. refused: references that could not be planned, with the reason; their trials were not run."""
    rows = results.rows
    of_all = tables(rows)
    names = [name for name in plan.conditions if any(table.conditions == name for table in of_all)]
    parts = []
    for name in names:
        own = [table for table in of_all if table.conditions == name]
        words = ", ".join(f"{key} {value}" for key, value in asdict(plan.conditions[name]).items() if value is not None)
        both = [_table(table, which) for table in own for which in MapKind]
        parts.append(Section(name, judge_claims(plan.claims, own), both, about=words))
    left_out = sum(plan.reference(trial) in refused for trial in plan.trials())
    return Report(
        parts, [] if results.preliminary else _figures(rows, of_all, plan, results.out, description),
        page=("rtstack.papers.impact_maps", PAGE), left_out=left_out, reached=not refused,
        warnings=[f"the plan {one.file} is refused, its trials are left out: {why}" for one, why in refused.items()],
        values={
            "refused": {reference.file.removesuffix(".mcap"): reason for reference, reason in refused.items()},
            "overview": _overview(of_all) if len(names) > 1 else [],
            "failures": Counter(row["failure_reason"] for row in rows if not row["success"]),
        },
    )  # fmt: skip


def _table(table: Fitted, which: MapKind) -> Table:
    """Return a table of the paper's form with the predictions of one map; errors of lines are of all robots' trials."""
    paper, kinds = PAPER[table.motion], [(which, kind) for kind in NAMES]
    lines = []
    for cell in table.cells:
        theirs = PAPER_LINES[table.motion].get(cell.object, ())
        number = int(cell.case) - 1 if cell.case.isdigit() else len(theirs)
        estimate, error = theirs[number] if number < len(theirs) else (None, None)
        lines.append([
            f"{cell.object.replace('_', ' ')}: case {cell.case}",
            "-" if estimate is None else f"{estimate:.3f} m/s", _estimate(cell), percent(error),
            *(percent(cell.error_percent(kind)) for kind in kinds),
            "-" if cell.swing_percent is None else f"{cell.swing_percent:.2f} %",
            "-" if cell.fit is None else f"{cell.fit.r_squared:.4f}",
            f"{len(cell.points)}" + (f" ({cell.excluded} left out)" if cell.excluded else ""),
        ])  # fmt: skip
    bias = [shown(table.average(kind), " %", 2) for kind in kinds]
    absolute = [shown(table.absolute(kind), " %", 2) for kind in kinds]
    over_swing = [shown(table.absolute(kind, over_swing=True), " %", 2) for kind in kinds]
    theirs = [percent(paper[kind][0]) for kind in NAMES], [percent(paper[kind][1]).lstrip("+") for kind in NAMES]
    lines += [
        ["Average error", "", "", "", *bias, "", "", ""],
        ["paper", "", "", "", *theirs[0], "", "", ""],
        ["Absolute error", "", "", "", *absolute, "", "", ""],
        ["paper", "", "", "", *theirs[1], "", "", ""],
        ["Absolute error, feedback over its last swing", "", "", "", *over_swing, "", "", ""],
    ]
    headings = (
        "", "estimate, paper", "here [95 % interval]", "B_theta, paper", *NAMES.values(), "swing", "R²", "trials",
    )  # fmt: skip
    title = "the paper's map, a single step" if which is MapKind.SINGLE_STEP else "our converged map"
    return Table(f"{TABLES[table.motion]}: {table.motion}, {title}", headings, lines)


def percent(value: float | None) -> str:
    return "-" if value is None else f"{value:+.2f} %"


def _estimate(cell: Cell) -> str:
    if cell.fit is None:
        return "-"
    between = "" if cell.fit.low is None else f" [{cell.fit.low:.3f}, {cell.fit.high:.3f}]"
    return f"{cell.fit.estimate:.3f} m/s{between}"


def _overview(of_all: Sequence[Fitted]) -> list[list[str]]:
    """Return a line for each set of conditions, table and map: what differs between them, side by side."""
    lines = []
    for table in of_all:
        r_squared = "-" if table.r_squared is None else f"{table.r_squared:.4f}"
        for which in MapKind:
            kinds = [(which, kind) for kind in NAMES]
            errors = [*map(table.average, kinds), *map(table.absolute, kinds)]
            words = ["-" if error is None else f"{error.mean:+.2f} %" for error in errors]
            lines.append([table.conditions, f"{table.motion}, {which}", *words, r_squared])
    return lines


def _figures(
    rows: list[Row], of_all: Sequence[Fitted], plan: ValidationPlan, out: Path, description: CellDescription
) -> list[Figure]:
    arms = arm_controllers(description, cell_parameters(description))
    found = []
    for table in of_all:
        if table.conditions != next(iter(plan.conditions)):
            continue
        thing, number = SHOWN[table.motion]
        cell = next(
            (c for c in table.cells if c.object == thing and c.case == str(number + 1) and c.points),
            next((c for c in table.cells if c.points), None),
        )
        if cell is None:
            continue
        of = f"{cell.object}, case {cell.case}, {table.motion}"
        first, second = NUMBERS[table.motion]
        signals = _signals(rows, table, cell, out, arms)
        found += [
            Figure(f"figure{first}.png", f"Figure {first}: {of}. Means over the trials of each velocity; dotted: the "
                   "nominal impact.", partial(draw_signals, by_scale=signals)),
            Figure(f"figure{second}.png", f"Figure {second}: {of}. Grey: the estimate's 95 % interval.",
                   partial(draw_fit, cell=cell)),
        ]  # fmt: skip
    return found


def _signals(
    rows: list[Row], table: Fitted, cell: Cell, out: Path, arms: tuple[ArmController, ...]
) -> dict[float, list[FeedbackSignal]]:
    found: dict[float, list[FeedbackSignal]] = {}
    for row in rows:
        same = (row["conditions"], row["motion"], row["object"], row["case_name"]) == (
            table.conditions, table.motion, cell.object, cell.case,
        )  # fmt: skip
        if same and row["success"] and row["complete"]:
            columns = log_columns(read_log(out / row["log"]))
            signal = feedback_signal(columns, row["nominal_impact_time_s"], arms, DIRECTIONS[table.motion])
            found.setdefault(row["scale"], []).append(signal)
    return found


# Okabe and Ito's colours, safe for colour-blind eyes
COLOURS = ("#56B4E9", "#009E73", "#000000", "#E69F00", "#D55E00")
WORDS = {MapKind.SINGLE_STEP: "single step", MapKind.CONVERGED: "converged"}
INERTIA = dict(zip(NAMES, (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", ":")), strict=True))


@mpl.rc_context(STYLE)
def draw_signals(path: Path, by_scale: Mapping[float, Sequence[FeedbackSignal]]) -> None:
    """Draw velocity, feedback and its integral, averaged over the trials of each scale (Figures 6 and 8)."""
    figure, axes = new_figure(7.5, 7.0, nrows=3, sharex=True)
    for colour, (scale, trials) in zip(COLOURS, sorted(by_scale.items()), strict=False):
        n = min(len(trial.t_s) for trial in trials)
        t_ms = 1e3 * trials[0].t_s[:n]
        velocity, reference, feedback, integral = (
            np.mean([getattr(trial, name)[:n] for trial in trials], axis=0)
            for name in ("velocity", "reference", "feedback", "integral")
        )
        axes[0][0].plot(t_ms, reference, color=colour, linestyle="--", linewidth=0.9)
        axes[0][0].plot(t_ms, velocity, color=colour, label=f"{scale:g} of the prediction")
        axes[1][0].plot(t_ms, feedback, color=colour)
        axes[2][0].plot(t_ms, integral, color=colour)
    for axis, label in zip(
        axes[:, 0], ("velocity, m/s\n(dashed: reference)", "feedback (28), m/s$^2$", "its integral, m/s"), strict=True
    ):
        axis.axvline(0.0, color="#555555", linestyle=":", linewidth=0.9)
        axis.axhline(0.0, color="#555555", linewidth=0.6)
        axis.set_ylabel(label)
    axes[2][0].set_xlabel("time from the nominal impact, ms")
    figure.legend(loc="outside lower center", ncols=3)
    save(figure, path)


@mpl.rc_context(STYLE)
def draw_fit(path: Path, cell: Cell) -> None:
    """Draw net feedback over the planned velocity, the fitted line, its zero and the predictions (Figures 7 and 9)."""
    figure, axes = new_figure(7.5, 3.8)
    axis = axes[0][0]
    v, net = (np.array(column) for column in zip(*cell.points, strict=True))
    axis.plot(v, net, "o", color="#555555", markersize=4, label="trials")
    if cell.fit is not None:
        ends = np.array([v.min(), v.max()])
        axis.plot(ends, cell.fit.slope * (ends - cell.fit.estimate), color="#999999", label="fit")
        axis.axvline(cell.fit.estimate, color="#000000", linewidth=1.6, label=f"estimate {cell.fit.estimate:.3f} m/s")
        if cell.fit.low is not None and cell.fit.high is not None:
            axis.axvspan(cell.fit.low, cell.fit.high, color="#000000", alpha=0.1, linewidth=0)
    for which, kind in product(MapKind, INERTIA):
        width = 1.6 if which is MapKind.SINGLE_STEP else 0.8
        colour, style = INERTIA[kind]
        error = cell.error_percent((which, kind))
        label = f"{WORDS[which]}, {NAMES[kind]}" + ("" if error is None else f" ({error:+.2f} %)")
        axis.axvline(cell.predicted[which, kind], color=colour, linestyle=style, linewidth=width, label=label)
    axis.axhline(0.0, color="#555555", linewidth=0.6)
    axis.set_xlabel("post-impact velocity of the reference, m/s")
    axis.set_ylabel("net feedback (29), m/s")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    save(figure, path)
