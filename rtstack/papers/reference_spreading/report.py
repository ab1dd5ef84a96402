"""The report of a comparison of controllers: the paper's claims, tables and figures, and generic ones for the rest."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rtstack.control.parameters import CompletionParameters, ControlParameters
from rtstack.experiments.archive import Archive
from rtstack.experiments.claims import Claim, shown
from rtstack.experiments.experiment import Results, Row
from rtstack.experiments.generic import mean_figure, mean_table
from rtstack.experiments.report import PAGE, Figure, Report, Section, Table
from rtstack.experiments.statistics import Interval, stratified_mean
from rtstack.model.cell_description import CellDescription
from rtstack.papers.conditions import RECORDINGS, Reference
from rtstack.papers.demonstrations import Bench
from rtstack.papers.reference_spreading.claims import judge_claims
from rtstack.papers.reference_spreading.controllers import NAMES, Controller, millimetres, name_of
from rtstack.papers.reference_spreading.evaluation import FIGURE11, PAPER_TABLE2, TABLE2, Evaluation, place_of
from rtstack.papers.reference_spreading.evaluation import every as counted
from rtstack.papers.reference_spreading.figures import figure5, figure8, figure10, figure11, figure_hands, logged_trial
from rtstack.papers.reference_spreading.plan import Plan
from rtstack.references.recording import load_recording
from rtstack.references.spreading import extend
from rtstack.trials.assembly import arm_controllers, cell_parameters

OURS, THEIRS = Controller.CONTACT_COMPLETION, Controller.PROPOSED
COMPARED = (THEIRS, OURS)
FORCE_NORM = "mean force norm"
MARGIN_MS = "margin_ms"  # a column of ours: see _margin_ms


@dataclass(frozen=True, slots=True)
class Comparison:
    """A line of the section: what is compared, both means, the paired difference (ours - theirs), and what it says."""

    what: str
    theirs: str
    ours: str
    difference: str
    verdict: str


def judge_beyond(evaluation: Evaluation) -> list[Comparison]:
    """Return every comparison for which there are trials of both. evaluation: of COMPARED, at least."""
    # Figure 11's repetitions where there are any: Table II has one of each
    rows = [row | {MARGIN_MS: _margin_ms(row)} for row in evaluation.of(FIGURE11) or evaluation.of(TABLE2)]
    displaced = [row for row in rows if row["displacement_mm"]]
    in_place = [row for row in rows if not row["displacement_mm"]]
    norms = {f"at {millimetres(d)}": evaluation.of(FIGURE11, displacement_mm=d) for d in evaluation.displacements()}
    lines = [
        _compared(f"{FORCE_NORM} {where}", some, "average_force_norm")
        for where, some in (norms or {"with the object displaced": displaced}).items()
    ]
    lines += [
        _compared(f"{what}, object displaced", displaced, column, unit, digits)
        for what, column, unit, digits in (
            ("highest force norm in the 200 ms", "peak_in_window", "", 1),
            ("highest force norm of the trial", "peak_force_norm", "", 1),
            ("largest change of the desired wrenches in a tick", "largest_step", " N", 2),
            ("change in the tick that ends the interim mode", "step_to_post", " N", 2),
            ("swing of the pad that is hit first", "swing_m_s", " m/s", 3),
            ("from full contact to the interim mode's end", MARGIN_MS, " ms", 1),
            ("duration of the interim mode", "interim_ms", " ms", 1),
        )
    ]
    lines.append(_compared("duration of the interim mode, object in place", in_place, "interim_ms", " ms"))
    found = [line for line in lines if line is not None]
    return [*found, _grabs(evaluation)] if found else []


def _margin_ms(row: Row) -> float | None:
    """How long after full contact the interim mode ended, ms: negative where it ended before."""
    needed = row["detected_impact_time_s"], row["interim_ms"], row["contact_completed_s"]
    if any(value is None for value in needed):
        return None
    return 1e3 * (row["detected_impact_time_s"] - row["contact_completed_s"]) + row["interim_ms"]


def _compared(what: str, rows: list[Row], column: str, unit: str = "", digits: int = 1) -> Comparison | None:
    both = _pairs([row for row in rows if row["success"]], column)
    if not both:
        return None
    means = [_mean({key: pair[controller] for key, pair in both.items()}) for controller in COMPARED]
    difference = _mean({key: pair[OURS] - pair[THEIRS] for key, pair in both.items()})
    theirs, ours = (shown(mean, unit, digits) for mean in means)
    return Comparison(what, theirs, ours, shown(difference, unit, digits), _verdict(difference, means[0]))


def _pairs(rows: list[Row], column: str) -> dict[tuple[object, ...], dict[str, float]]:
    """Return the values of each repetition by controller, where both have one; the repetition is the key's end."""
    pairs: dict[tuple[object, ...], dict[str, float]] = defaultdict(dict)
    for row in rows:
        if row[column] is not None:
            key = row["experiment"], row["reference"], place_of(row), row["repetition"]
            pairs[key][row["controller"]] = row[column]
    return {key: pair for key, pair in pairs.items() if len(pair) == len(COMPARED)}


def _mean(values: dict[tuple[object, ...], float]) -> Interval:
    """Mean and interval over the repetitions; with one of each, over references and displacements."""
    groups: dict[object, list[float]] = defaultdict(list)
    for (*of, _), value in values.items():
        groups[tuple(of)].append(value)
    if all(len(group) < 2 for group in groups.values()):
        groups = defaultdict(list, {None: list(values.values())})
    interval = stratified_mean(groups)
    assert interval is not None, "there is a pair"
    return interval


def _verdict(difference: Interval, theirs: Interval) -> str:
    """Say what a paired difference shows, and no more than that."""
    if difference.low is None or difference.high is None:
        return "cannot be told: one pair"
    share = f" by {100.0 * abs(difference.mean / theirs.mean):.0f} %" if theirs.mean > 0.0 else ""
    if difference.high < 0.0:
        return f"lower{share}"
    if difference.low > 0.0:
        return f"higher{share}"
    return "no difference that these trials can tell"


def _grabs(evaluation: Evaluation) -> Comparison:
    """Successful grabs, and in how many pairs one of both alone succeeded."""
    both = list(_pairs(evaluation.rows, "success").values())
    theirs, ours = (f"{sum(pair[c] > 0 for pair in both)} of {len(both)}" for c in COMPARED)
    lost = sum(pair[THEIRS] and not pair[OURS] for pair in both)
    won = sum(pair[OURS] and not pair[THEIRS] for pair in both)
    verdict = "no difference" if lost == won == 0 else "fewer" if lost > won else "more" if won > lost else "as many"
    return Comparison("successful grabs, all trials", theirs, ours, f"{won} won, {lost} lost", verdict)


def summary(lines: list[Comparison]) -> str:
    """Return the section's verdict in words: where the force norm is lower and where it is higher."""
    norms = [line for line in lines if line.what.startswith(FORCE_NORM)]
    name = name_of(OURS)
    parts = []
    for word in ("lower", "higher", "no difference", "cannot be told"):
        where = [line.what.removeprefix(FORCE_NORM).strip() for line in norms if line.verdict.startswith(word)]
        if where:
            parts.append(f"{word} {', '.join(where)}")
    return f"{name} against {name_of(THEIRS).lower()}, {FORCE_NORM}: {'; '.join(parts)}." if parts else ""


PACKAGE = "rtstack.papers.reference_spreading"
EXAMPLE_MM = -30.0  # the displacement of the paper's figures of single trials
# what a table of any experiment shows of each controller and displacement: column -> heading
SHOWN = {
    "success": "success", "average_force_norm": "mean force norm (33)", "max_lift_mm": "highest lift, mm",
    "peak_torque_ratio": "highest torque over its limit",
}  # fmt: skip
# the columns of the table that lays conditions side by side: heading, column of the results, unit, digits, factor
SIDE_BY_SIDE = (
    ("mean force norm", "average_force_norm", "", 1, 1.0),
    ("delay of the detection", "detection_delay_ms", " ms", 1, 1.0),
    ("rise meanwhile", "delay_peak", "", 1, 1.0),
    ("swing of the pad", "swing_m_s", " m/s", 3, 1.0),
    ("highest torque over its limit", "peak_torque_ratio", " %", 0, 100.0),
)

LIMITS = {
    "limited_ticks": "position, velocity or torque, in the QP",
    "rate_limited_ticks": "rate of the torque, after it",
}
MOST_DRAWN = 50  # trials in a figure


def report(plan: Plan, bench: Bench, results: Results, unrecorded: Mapping[str, str]) -> Report:
    """Return the report of a campaign. unrecorded: references without a recording, and why there is none."""
    rows = results.rows
    evaluations = [Evaluation(rows, name) for name in plan.conditions if any(row["conditions"] == name for row in rows)]
    claims = {each.conditions: judge_claims(plan.claims, each) for each in evaluations}
    parts = [_part(rows, evaluation, plan, claims[evaluation.conditions]) for evaluation in evaluations]
    several = len(evaluations) > 1
    figures = [] if results.preliminary else _single_trials(rows, bench.archive, bench.description)
    if plan.hands is not None:
        hands, caption = plan.hands, "Which claim holds with which hand, law and pad stiffness."
        figures.insert(0, Figure("hands.png", caption, lambda path: figure_hands(path, hands, claims)))
    chosen = [one.name for each in plan.experiments for one in plan.chosen(each, rows, unrecorded)]
    return Report(
        parts, figures, page=(PACKAGE, PAGE),
        values={
            "headings": ["success", "lift difference", *(heading for heading, *_ in SIDE_BY_SIDE)],
            "overview": _overview(evaluations) if several else [],
            "conditions": {name: _words(asdict(plan.conditions[name])) for name in plan.conditions},
            "references": [reference.name for reference in plan.references()], "chosen": chosen,
            "unrecorded": unrecorded,
            "completion": CompletionParameters(), "control": ControlParameters(),
            "beyond": {each: judge_beyond(Evaluation(rows, each, COMPARED)) for each in plan.conditions},
            "summary": summary,
        },
        warnings=[f"{name} could not be recorded, its trials are left out: {why}" for name, why in unrecorded.items()],
        reached=not unrecorded or plan.hands is not None,  # that a hand hits too hard is what the map is for
    )  # fmt: skip


def _part(rows: list[Row], evaluation: Evaluation, plan: Plan, claims: Sequence[Claim]) -> Section:
    name = evaluation.conditions
    both = Evaluation(rows, name, COMPARED)
    every = Evaluation(rows, name, plan.controllers)
    tables, figures = [], []
    if evaluation.of(TABLE2):
        tables.append(_table2(evaluation))
    if failures := every.failures():
        counts = [[why, *(str(by.get(c, 0)) for c in plan.controllers)] for why, by in failures.items()]
        tables.append(Table("Failures", ("reason", *map(name_of, plan.controllers)), counts))
    # where limits acted that the paper has in another form, or has not: the departures of (12) to (14)
    acted = [[NAMES[c], *(shown(evaluation.mean(c, each, counted=counted)) for each in LIMITS)] for c in NAMES]
    title = "Ticks of a trial in which a limit acted that is not the paper's"
    tables.append(Table(title, ("", *LIMITS.values()), acted))
    if evaluation.of(FIGURE11):
        tables.append(_figure11_table(evaluation))
        caption = "Mean of (33) over the 200 ms around the nominal impact, by displacement; error bars: 95 % intervals."
        caption += " The paper prints this as a diagram without numbers: its order is in the claims."
        figures.append(Figure(f"figure11-{name}.png", caption, lambda path: figure11(path, evaluation)))
        if judge_beyond(both):
            of_both = "Mean of (33) as in Figure 11, with and without the detector of contact completion."
            figures.append(Figure(f"beyond-{name}.png", of_both, lambda path: figure11(path, both, COMPARED)))
    for own in dict.fromkeys(row["experiment"] for row in every.rows):
        if own not in (TABLE2, FIGURE11):
            some = [row | {"controller": name_of(row["controller"])} for row in every.of(own)]
            tables.append(mean_table(f"Experiment {own}", some, ("controller", "displacement_mm"), SHOWN))
            caption = f"Experiment {own}: mean of (33) over the 200 ms around the nominal impact; "
            figures.append(mean_figure(
                f"{own}-{name}.png", caption + "error bars: 95 % intervals.", some, "displacement_mm", "controller",
                "average_force_norm", "mean desired force norm, 200 ms around $T_r$",
            ))  # fmt: skip
    return Section(name, claims, tables, figures, numbers(evaluation), _words(asdict(plan.conditions[name])))


def _figure11_table(evaluation: Evaluation) -> Table:
    lines = [
        [label or millimetres(d), *(shown(evaluation.mean_force(c, d, column)) for c in NAMES)]
        for d in evaluation.displacements()
        for label, column in zip(("", "force part alone, N"), FORCES, strict=True)
    ]
    return Table("Figure 11: mean desired force norm", ("displacement", *NAMES.values()), lines)


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


def _table2(evaluation: Evaluation) -> Table:
    lines = []
    for line in evaluation.table2():
        success, lift = PAPER_TABLE2[line.controller]
        here = [shown(each, " mm", 2) for each in (line.lift_mm, line.repeated_lift_mm)]
        share = shown(line.success, " %", 0, 100.0)
        lines.append([NAMES[line.controller], f"{success:.0f} %", share, f"{lift:+.2f} mm", *here])
    headings = ("", "successful, paper", "here", "lift difference, paper", "here", "here, of Figure 11's rice boxes")
    return Table("Table II: successful grabs and lift", headings, lines)


def _single_trials(rows: list[Row], archive: Archive, description: CellDescription) -> list[Figure]:
    some = [row for row in rows if row["displacement_mm"] == EXAMPLE_MM]
    example = next(
        (row for name in (FIGURE11, TABLE2) for row in some if row["experiment"] == name), next(iter(some), None)
    )
    if example is None:
        return []
    wanted = ("experiment", "conditions", "reference", "displacement_mm")
    same = [row for row in some if all(row[name] == example[name] for name in wanted)]
    which, same = "every repetition" if len(same) <= MOST_DRAWN else "the first repetitions", same[:MOST_DRAWN]
    parameters = cell_parameters(description)
    file = archive.file(f"{RECORDINGS}/{Reference.named(example['reference']).file}")
    arms, control = arm_controllers(description, parameters), parameters.control
    recording = load_recording(file, arms, parameters.detector, control.period_s)
    reference = extend(recording, control.exclusion_s)
    nominal_s = reference.nominal_impact_s
    logged = [
        logged_trial(archive.file(row["log"]), row["controller"], row["object"], description, nominal_s) for row in same
    ]
    first = {trial.controller: trial for trial in reversed(logged)}
    papers = [trial for trial in logged if trial.controller in NAMES]
    name, of = example["reference"], f"{example['reference']}, {EXAMPLE_MM:+g} mm"
    found = [
        Figure("figure5.png", f"Figure 5: the recording {name} around its impact, and the extended references. Right "
               "arm, towards the object; grey: the interval that is left out.",
               lambda path: figure5(path, recording, reference))
    ]  # fmt: skip
    if papers:
        log = f"log {example['log']} and its three fellows"
        columns = {c: first[c] for c in NAMES if c in first}
        found += [
            Figure("figure8.png", f"Figure 8: velocity and desired force towards the object ({of}, {log}).",
                   lambda path: figure8(path, columns, reference, EXAMPLE_MM)),
            Figure("figure10.png", f"Figure 10: desired force norm (33), {of}, {which}.",
                   lambda path: figure10(path, papers, nominal_s)),
        ]  # fmt: skip
    pair = [trial for trial in logged if trial.controller in COMPARED]
    if len({trial.controller for trial in pair}) == len(COMPARED):
        caption = f"Beyond the paper: desired force norm (33) with and without the detector, {of}."
        found.append(Figure("beyond.png", caption, lambda path: figure10(path, pair, nominal_s)))
    return found


def _words(values: Mapping[str, Any]) -> str:
    known = {name: value for name, value in values.items() if value is not None}
    return ", ".join(f"{name} {_word(value)}" for name, value in known.items())


def _word(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"({_words(value)})"
    return value if isinstance(value, str) else f"{value:g}"


FORCES = ("average_force_norm", "average_force_norm_linear_n")
# the columns of results.csv whose means are behind the claims
COLUMNS = (
    *FORCES, "peak_torque_ratio", "detection_delay_ms", "delay_peak", "delay_peak_velocity_share", "peak_in_window",
    "largest_step", "largest_step_ms", "step_to_interim", "step_to_post", "settled_ms", "swing_m_s",
    "swing_other_m_s", "largest_step_other",
    "posture_peak", "slip_mm", "lost_ms", "limited_ticks", "rate_limited_ticks",
)  # fmt: skip


def numbers(evaluation: Evaluation) -> dict[str, Any]:
    """Return the figures behind the claims under one set of conditions.

    A figure is a mean with its 95 % interval and n, SI units or as its column says; null where there is none.
    """
    table2 = evaluation.table2() if evaluation.of(TABLE2) else []
    return {
        "table2": [asdict(line) for line in table2],
        "figure11": [
            {"controller": str(controller), "displacement_mm": d}
            | {name: _figure(evaluation.mean_force(controller, d, name)) for name in FORCES}
            for d in evaluation.displacements()
            for controller in NAMES
        ],
        "means": [
            {"controller": str(controller), "column": name, "mean": _figure(evaluation.mean(controller, name))}
            for controller in NAMES
            for name in COLUMNS
        ],
    }  # fmt: skip


def _figure(interval: Interval | None) -> dict[str, float | None] | None:
    return None if interval is None else asdict(interval)
