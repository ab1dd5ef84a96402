"""The report of a campaign: PNG figures, CSV, and one HTML page that needs nothing else."""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtstack.campaign.archive import Archive
from rtstack.campaign.beyond import COMPARED, Comparison, judge_beyond, summary
from rtstack.campaign.claims import Claim, judge_claims, millimetres, shown
from rtstack.campaign.evaluation import ALL_NAMES, FIGURE11, NAMES, PAPER_TABLE2, TABLE2, Evaluation
from rtstack.campaign.figures import figure5, figure8, figure10, figure11, logged_trial
from rtstack.campaign.numbers import write_numbers
from rtstack.campaign.page import FIGURES, PAGE, embedded, page_template
from rtstack.campaign.plan import Experiment, Plan, PlanFile
from rtstack.campaign.sensitivity import figure_sensitivity, outcomes
from rtstack.campaign.store import Row, Store
from rtstack.campaign.trial import Reference
from rtstack.campaign.worker import RECORDINGS
from rtstack.control.parameters import CompletionParameters, ControlParameters
from rtstack.model.cell_description import CellDescription
from rtstack.references.recording import load_recording
from rtstack.references.spreading import extend
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.specification import Controller

EXAMPLE_MM = -30.0  # the displacement of the paper's figures of single trials

Chosen = Callable[[Experiment], list[Reference]]


# the columns of the table that lays conditions side by side: heading, column of the results, unit, digits, factor
SIDE_BY_SIDE = (
    ("mean force norm", "average_force_norm", "", 1, 1.0),
    ("delay of the detection", "detection_delay_ms", " ms", 1, 1.0),
    ("rise meanwhile", "delay_peak", "", 1, 1.0),
    ("swing of the pad", "swing_m_s", " m/s", 3, 1.0),
    ("highest torque over its limit", "peak_torque_ratio", " %", 0, 100.0),
)


@dataclass(frozen=True, slots=True)
class Part:
    """The report under one set of conditions, as the page shows it."""

    name: str
    conditions: str
    claims: list[Claim]
    table2: list[dict[str, str]]
    force: list[dict[str, Any]]
    failures: dict[str, list[int]]
    figure11: str | None
    beyond: list[Comparison]
    beyond_verdict: str
    beyond_figure: str | None


def write_report(
    store: Store, plan: Plan, file: PlanFile, description: CellDescription, chosen: Chosen, archive: Archive
) -> Path:
    """Write results.csv, times.csv, figures/*.png, report.html and report.json. Returns the page's path.

    archive: where recordings and logs are.
    """
    selected = {experiment.name: chosen(experiment) for experiment in plan.experiments}
    trials = [trial for e in plan.experiments for trial in plan.trials(e, selected[e.name])]
    rows = store.rows(trials)
    store.write_csv(rows)
    folder = store.out / FIGURES
    folder.mkdir(exist_ok=True)
    names = [name for name in plan.conditions if any(row["conditions"] == name for row in rows)]
    evaluations = [Evaluation(rows, name) for name in names]
    parts = [_part(rows, name, plan, folder) for name in names]
    several = len(names) > 1
    if several:
        figure_sensitivity(folder / "sensitivity.png", evaluations)
    figures = _single_trials(rows, archive, folder, description)
    about = store.about()
    page = page_template(PAGE, "rtstack.campaign").render(
        figure=lambda name, caption: embedded(folder / name, caption),
        plan=plan, file=file, rows=rows, planned=plan.size(), parts=parts, figures=figures,
        headings=["success", "lift difference", *(heading for heading, *_ in SIDE_BY_SIDE)],
        overview=_overview(evaluations) if several else [], outcomes=outcomes(evaluations) if several else [],
        verdicts=Counter(str(claim.verdict) for part in parts for claim in part.claims),
        controllers=list(NAMES.values()), failing=[ALL_NAMES[c] for c in plan.controllers],
        plan_commit=about["plan_commit"],
        commits=sorted({row["git_commit"] for row in rows}),
        conditions={name: _words(asdict(plan.conditions[name])) for name in names},
        references=[reference.name for reference in plan.references()],
        completion=CompletionParameters(), control=ControlParameters(),
        chosen=[reference.name for references in selected.values() for reference in references],
        pace=pace(store.invocations()),
    )  # fmt: skip
    path = store.out / PAGE
    path.write_text(page, encoding="utf-8")
    write_numbers(store.out, plan, [(e, part.claims) for e, part in zip(evaluations, parts, strict=True)])
    return path


def _part(rows: list[Row], conditions: str, plan: Plan, folder: Path) -> Part:
    evaluation, both = Evaluation(rows, conditions), Evaluation(rows, conditions, COMPARED)
    failures = Evaluation(rows, conditions, plan.controllers).failures()
    has_force, has_table = bool(evaluation.of(FIGURE11)), bool(evaluation.of(TABLE2))
    drawn = drawn_beyond = None
    if has_force:
        drawn = f"figure11-{conditions}.png"
        figure11(folder / drawn, evaluation)
    beyond = judge_beyond(both)
    if beyond and has_force:
        drawn_beyond = f"beyond-{conditions}.png"
        figure11(folder / drawn_beyond, both, COMPARED)
    return Part(
        name=evaluation.conditions,
        conditions=_words(asdict(plan.conditions[evaluation.conditions])),
        claims=judge_claims(evaluation),
        table2=_table2(evaluation) if has_table else [],
        force=[
            {
                "displacement": millimetres(d),
                "norm": [shown(evaluation.mean_force(c, d)) for c in NAMES],
                "linear": [shown(evaluation.mean_force(c, d, "average_force_norm_linear_n")) for c in NAMES],
            }
            for d in evaluation.displacements()
        ],
        failures={why: [by.get(c, 0) for c in plan.controllers] for why, by in failures.items()},
        figure11=drawn,
        beyond=beyond,
        beyond_verdict=summary(beyond),
        beyond_figure=drawn_beyond,
    )


def _overview(evaluations: list[Evaluation]) -> list[list[str]]:
    """Return a line for each set of conditions and controller: what differs between them, side by side."""
    lines = []
    for evaluation in evaluations:
        for line in evaluation.table2():
            cells = [
                shown(evaluation.mean(line.controller, column), unit, digits, factor)
                for _, column, unit, digits, factor in SIDE_BY_SIDE
            ]
            success, lift = shown(line.success, " %", 0, 100.0), shown(line.lift_mm, " mm", 2)
            lines.append([evaluation.conditions, NAMES[line.controller], success, lift, *cells])
    return lines


def _table2(evaluation: Evaluation) -> list[dict[str, str]]:
    lines = []
    for line in evaluation.table2():
        success, lift = PAPER_TABLE2[line.controller]
        lines.append(
            {
                "name": NAMES[line.controller],
                "paper_success": f"{success:.0f} %",
                "success": shown(line.success, " %", 0, 100.0),
                "paper_lift": f"{lift:+.2f} mm",
                "lift": shown(line.lift_mm, " mm", 2),
            }
        )
    return lines


def _single_trials(
    rows: list[Row], archive: Archive, folder: Path, description: CellDescription
) -> list[tuple[str, str]]:
    """Draw figures 5, 8 and 10 from a rice box's reference; returns their names and captions."""
    some = [row for row in rows if row["displacement_mm"] == EXAMPLE_MM]
    example = next(
        (row for name in (FIGURE11, TABLE2) for row in some if row["experiment"] == name), next(iter(some), None)
    )
    if example is None:
        return []
    wanted = ("experiment", "conditions", "reference", "displacement_mm")
    same = [row for row in some if all(row[name] == example[name] for name in wanted)]
    parameters = cell_parameters(description)
    recording = load_recording(
        archive.file(f"{RECORDINGS}/{Reference.named(example['reference']).file}"),
        arm_controllers(description, parameters),
        parameters.detector,
        parameters.control.period_s,
    )
    reference = extend(recording, parameters.control.exclusion_s)
    logged = [
        logged_trial(archive.file(row["log"]), Controller(row["controller"]), row["object"], description)
        for row in same
    ]
    first = {trial.controller: trial for trial in reversed(logged)}
    figure5(folder / "figure5.png", recording, reference)
    figure8(folder / "figure8.png", {c: first[c] for c in NAMES if c in first}, reference, example["displacement_mm"])
    papers = [trial for trial in logged if trial.controller in NAMES]
    figure10(folder / "figure10.png", papers, reference.nominal_impact_s)
    name, of = example["reference"], f"{example['reference']}, {EXAMPLE_MM:+g} mm"
    log = f"log {example['log']} and its three fellows"
    drawn = [
        ("figure5.png", f"Figure 5: the recording {name} around its impact, and the extended references. Right arm, "
         "towards the object; grey: the interval that is left out."),
        ("figure8.png", f"Figure 8: velocity and desired force towards the object ({of}, {log})."),
        ("figure10.png", f"Figure 10: desired force norm (33), {of}, every repetition."),
    ]  # fmt: skip
    pair = [trial for trial in logged if trial.controller in COMPARED]
    if len({trial.controller for trial in pair}) == len(COMPARED):
        figure10(folder / "beyond.png", pair, reference.nominal_impact_s)
        drawn.append(("beyond.png", f"Beyond the paper: desired force norm (33) with and without the detector, {of}."))
    return drawn


def _words(values: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in values.items() if value is not None)


def pace(invocations: list[Row]) -> str:
    """Return in words how fast a campaign's invocations went."""
    robot_s, wall_s = (sum(each[name] for each in invocations) for name in ("robot_s", "wall_s"))
    if not wall_s:
        return "-"
    workers = sorted({int(each["workers"]) for each in invocations})
    return (
        f"{robot_s / wall_s:.1f}: {robot_s:.0f} s of the robot in {wall_s:.0f} s, logs included, with "
        f"{' or '.join(map(str, workers))} workers, as measured while it ran"
    )
