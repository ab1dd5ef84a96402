"""The report of a validation campaign: CSV, figures, and one HTML page that needs nothing else."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtstack.campaign.claims import Claim
from rtstack.campaign.page import FIGURES, PAGE, embedded, page_template
from rtstack.campaign.plan import PlanFile
from rtstack.campaign.report import pace
from rtstack.campaign.store import Row, Store
from rtstack.control.tick import ArmController
from rtstack.impact_map import ReflectedInertia
from rtstack.impact_validation import figures
from rtstack.impact_validation.claims import judge_claims, percent
from rtstack.impact_validation.evaluation import NAMES, PAPER, PAPER_LINES, TABLES, Cell, Table, combined, tables
from rtstack.impact_validation.feedback import FeedbackSignal, feedback_signal
from rtstack.impact_validation.plan import DIRECTIONS, PlannedReference, ValidationPlan
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.references.motion import Motion
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.review import log_columns

# the sets of the paper's figures 6 and 7 (cat food, case 2) and 8 and 9 (juice, case 3): object, index of the case
SHOWN = {Motion.HIT_AND_PUSH: ("box_130", 1), Motion.GRAB: ("box_220", 2)}
NUMBERS = {Motion.HIT_AND_PUSH: (6, 7), Motion.GRAB: (8, 9)}


@dataclass(frozen=True, slots=True)
class Part:
    """The report under one set of conditions, as the page shows it."""

    name: str
    conditions: str
    claims: list[Claim]
    tables: list[dict[str, Any]]


def write_report(
    store: Store, plan: ValidationPlan, file: PlanFile, description: CellDescription,
    refused: Mapping[PlannedReference, str] | None = None,
) -> Path:  # fmt: skip
    """Write results.csv, times.csv, figures/*.png and report.html. Returns the page's path.

    refused: references that could not be planned, with the reason; their trials were not run.
    """
    refused = refused or {}
    left_out = sum(plan.reference(trial) in refused for trial in plan.trials())
    rows = store.rows(plan.trials())
    store.write_csv(rows)
    folder = store.out / FIGURES
    folder.mkdir(exist_ok=True)
    of_all = tables(rows)
    names = [name for name in plan.conditions if any(table.conditions == name for table in of_all)]
    parts = []
    for name in names:
        own = [table for table in of_all if table.conditions == name]
        words = ", ".join(f"{key} {value}" for key, value in asdict(plan.conditions[name]).items() if value is not None)
        parts.append(Part(name, words, judge_claims(own), [_table(table) for table in own]))
    drawn = _figures(rows, of_all, plan, store.out, folder, description)
    page = page_template(PAGE, "rtstack.impact_validation").render(
        figure=lambda name, caption: embedded(folder / name, caption),
        plan=plan, file=file, rows=rows, planned=plan.size(), left_out=left_out, parts=parts, figures=drawn,
        refused={reference.file.removesuffix(".mcap"): reason for reference, reason in refused.items()},
        overview=_overview(of_all) if len(names) > 1 else [],
        verdicts=Counter(str(claim.verdict) for part in parts for claim in part.claims),
        plan_commit=store.about()["plan_commit"], commits=sorted({row["git_commit"] for row in rows}),
        failures=Counter(row["failure_reason"] for row in rows if not row["success"]), pace=pace(store.invocations()),
    )  # fmt: skip
    path = store.out / PAGE
    path.write_text(page, encoding="utf-8")
    return path


def _table(table: Table) -> dict[str, Any]:
    paper = PAPER[table.motion]
    lines = []
    for cell in table.cells:
        theirs = PAPER_LINES[table.motion].get(cell.object, ())
        number = int(cell.case) - 1 if cell.case.isdigit() else len(theirs)
        estimate, error = theirs[number] if number < len(theirs) else (None, None)
        lines.append(
            {
                "name": f"{cell.object}: case {cell.case}",
                "paper": "-" if estimate is None else f"{estimate:.3f} m/s",
                "estimate": _estimate(cell),
                "paper_error": percent(error),
                "errors": [percent(cell.error_percent(kind)) for kind in NAMES],
                "over_swing": percent(cell.error_percent(ReflectedInertia.B_THETA, over_swing=True)),
                "swing": "-" if cell.swing_percent is None else f"{cell.swing_percent:.2f} %",
                "r_squared": "-" if cell.fit is None else f"{cell.fit.r_squared:.4f}",
                "n": f"{len(cell.points)}" + (f" ({cell.excluded} left out)" if cell.excluded else ""),
            }
        )
    return {
        "name": TABLES[table.motion],
        "motion": str(table.motion),
        "kinds": list(NAMES.values()),
        "lines": lines,
        "average": [percent(table.average(kind)) for kind in NAMES],
        "absolute": [percent(table.absolute(kind)).lstrip("+") for kind in NAMES],
        "average_over_swing": percent(table.average(ReflectedInertia.B_THETA, over_swing=True)),
        "absolute_over_swing": percent(table.absolute(ReflectedInertia.B_THETA, over_swing=True)).lstrip("+"),
        "paper_average": [percent(paper[kind][0]) for kind in NAMES],
        "paper_absolute": [percent(paper[kind][1]).lstrip("+") for kind in NAMES],
    }


def _estimate(cell: Cell) -> str:
    if cell.fit is None:
        return "-"
    between = "" if cell.fit.low is None else f" [{cell.fit.low:.3f}, {cell.fit.high:.3f}]"
    return f"{cell.fit.estimate:.3f} m/s{between}"


def _overview(of_all: Sequence[Table]) -> list[list[str]]:
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
    rows: list[Row], of_all: Sequence[Table], plan: ValidationPlan, out: Path, folder: Path,
    description: CellDescription,
) -> list[tuple[str, str]]:  # fmt: skip
    """Draw figures 6 to 9 of the first set of conditions; returns their names and captions."""
    arms = arm_controllers(description, cell_parameters(description))
    drawn = []
    conditions = next(iter(plan.conditions))
    for table in of_all:
        if table.conditions != conditions:
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
        figures.signals(folder / f"figure{first}.png", _signals(rows, table, cell, out, arms))
        figures.fit(folder / f"figure{second}.png", cell)
        drawn.append(
            (
                f"figure{first}.png",
                f"Figure {first}: {of}. Means over the trials of each velocity; dotted: the nominal impact.",
            )
        )
        drawn.append((f"figure{second}.png", f"Figure {second}: {of}. Grey: the estimate's 95 % interval."))
    return drawn


def _signals(
    rows: list[Row], table: Table, cell: Cell, out: Path, arms: tuple[ArmController, ArmController]
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
