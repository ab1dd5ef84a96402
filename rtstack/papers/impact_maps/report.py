"""The report of a validation campaign: the paper's tables, with ours beside them, and its figures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from rtstack.control.tick import ArmController
from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.page import PAGE
from rtstack.experiments.report import Figure, Report, Section, Table
from rtstack.impact_map import ReflectedInertia
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.papers.impact_maps import figures
from rtstack.papers.impact_maps.claims import judge_claims, percent
from rtstack.papers.impact_maps.evaluation import NAMES, PAPER, PAPER_LINES, TABLES, Cell, combined, tables
from rtstack.papers.impact_maps.evaluation import Table as Fitted
from rtstack.papers.impact_maps.feedback import FeedbackSignal, feedback_signal
from rtstack.papers.impact_maps.plan import DIRECTIONS, PlannedReference, ValidationPlan
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
        parts.append(Section(name, judge_claims(own), [_table(table) for table in own], about=words))
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


def _table(table: Fitted) -> Table:
    paper = PAPER[table.motion]
    lines = []
    for cell in table.cells:
        theirs = PAPER_LINES[table.motion].get(cell.object, ())
        number = int(cell.case) - 1 if cell.case.isdigit() else len(theirs)
        estimate, error = theirs[number] if number < len(theirs) else (None, None)
        lines.append(
            [
                f"{cell.object.replace('_', ' ')}: case {cell.case}",
                "-" if estimate is None else f"{estimate:.3f} m/s",
                _estimate(cell),
                percent(error),
                *(percent(cell.error_percent(kind)) for kind in NAMES),
                "-" if cell.swing_percent is None else f"{cell.swing_percent:.2f} %",
                percent(cell.error_percent(ReflectedInertia.B_THETA, over_swing=True)),
                "-" if cell.fit is None else f"{cell.fit.r_squared:.4f}",
                f"{len(cell.points)}" + (f" ({cell.excluded} left out)" if cell.excluded else ""),
            ]
        )
    bias = [percent(table.average(kind)) for kind in NAMES]
    absolute = [percent(table.absolute(kind)).lstrip("+") for kind in NAMES]
    over_swing = (
        percent(table.average(ReflectedInertia.B_THETA, over_swing=True)),
        percent(table.absolute(ReflectedInertia.B_THETA, over_swing=True)).lstrip("+"),
    )
    theirs = [percent(paper[kind][0]) for kind in NAMES], [percent(paper[kind][1]).lstrip("+") for kind in NAMES]
    lines += [
        ["Average error", "", "", "", *bias, "", over_swing[0], "", ""],
        ["paper", "", "", "", *theirs[0], "", "", "", ""],
        ["Absolute error", "", "", "", *absolute, "", over_swing[1], "", ""],
        ["paper", "", "", "", *theirs[1], "", "", "", ""],
    ]
    headings = (
        "", "estimate, paper", "here [95 % interval]", "B_theta, paper", *NAMES.values(), "swing",
        "B_theta over it", "R²", "trials",
    )  # fmt: skip
    return Table(f"{TABLES[table.motion]}: {table.motion}", headings, lines)


def _estimate(cell: Cell) -> str:
    if cell.fit is None:
        return "-"
    between = "" if cell.fit.low is None else f" [{cell.fit.low:.3f}, {cell.fit.high:.3f}]"
    return f"{cell.fit.estimate:.3f} m/s{between}"


def _overview(of_all: Sequence[Fitted]) -> list[list[str]]:
    """Return a line for each set of conditions and table: what differs between them, side by side."""
    lines = []
    for table in of_all:
        bias = [percent(table.average(kind)) for kind in NAMES]
        absolute = [percent(table.absolute(kind)).lstrip("+") for kind in NAMES]
        r_squared = "-" if table.r_squared is None else f"{table.r_squared:.4f}"
        lines.append([table.conditions, str(table.motion), *bias, *absolute, r_squared])
    for name in dict.fromkeys(table.conditions for table in of_all):
        both = [table for table in of_all if table.conditions == name]
        if len(both) > 1:
            absolute = [percent(combined(both, kind)).lstrip("+") for kind in NAMES]
            lines.append([name, "both", "", "", "", *absolute, ""])
    return lines


def _figures(
    rows: list[Row], of_all: Sequence[Fitted], plan: ValidationPlan, out: Path, description: CellDescription
) -> list[Figure]:
    """Return figures 6 to 9, of the first set of conditions."""
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
                   "nominal impact.", partial(figures.signals, by_scale=signals)),
            Figure(f"figure{second}.png", f"Figure {second}: {of}. Grey: the estimate's 95 % interval.",
                   partial(figures.fit, cell=cell)),
        ]  # fmt: skip
    return found


def _signals(
    rows: list[Row], table: Fitted, cell: Cell, out: Path, arms: tuple[ArmController, ArmController]
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
