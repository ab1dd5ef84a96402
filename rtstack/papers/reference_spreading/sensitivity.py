"""A campaign under several conditions: where the paper's orders appear, side by side, as a table and a figure."""

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from rtstack.experiments.statistics import Interval
from rtstack.papers.reference_spreading.claims import judge_claims
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.evaluation import PAPER_TABLE2, TABLE2, Evaluation
from rtstack.papers.reference_spreading.names import COLOURS, MARKERS, NAMES

FORCE = "average_force_norm"
# of the figure: heading, factor
PANELS = (("successful grabs, %", 100.0), ("lift difference, mm", 1.0), ("mean force norm, 200 ms around $T_r$", 1.0))


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of Table II's claims under conditions. verdicts: (claim, verdict); lowest: by mean force norm."""

    conditions: str
    verdicts: tuple[tuple[str, str], ...]
    lowest: str


def outcomes(evaluations: list[Evaluation]) -> list[Outcome]:
    """Return a line for each set of conditions."""
    return [
        Outcome(
            evaluation.conditions,
            tuple((c.says, str(c.verdict)) for c in judge_claims(evaluation) if c.where == "Table II"),
            _lowest(evaluation),
        )
        for evaluation in evaluations
    ]


def _lowest(evaluation: Evaluation) -> str:
    """The controller of the paper with the lowest mean force norm; those that the intervals cannot part from it."""
    force = {c: evaluation.mean(c, FORCE) for c in PAPER_TABLE2}
    known = sorted(((i.mean, c) for c, i in force.items() if i is not None), key=lambda pair: pair[0])
    if not known:
        return "-"
    first = known[0][1]
    best = force[first]
    others = [
        NAMES[c].lower() for _, c in known[1:] if best is not None and (i := force[c]) is not None and not best.below(i)
    ]
    return NAMES[first] + (f" (not apart: {', '.join(others)})" if others else "")


def figure_sensitivity(path: Path, evaluations: list[Evaluation]) -> None:
    """Draw success, lift and force norm of each controller under each set of conditions, with their 95 % intervals."""
    figure = Figure(figsize=(9.5, 1.2 + 0.42 * len(evaluations)), layout="constrained")
    axes = figure.subplots(1, len(PANELS), sharey=True)
    for index, controller in enumerate(NAMES):
        offset = 0.16 * (index - (len(NAMES) - 1) / 2)
        label = {"label": NAMES[controller]}
        for panel, (_, factor) in enumerate(PANELS):
            for k, evaluation in enumerate(evaluations):
                interval = _value(evaluation, controller, panel)
                if interval is None:
                    continue
                below = 0.0 if interval.low is None else interval.mean - interval.low
                above = 0.0 if interval.high is None else interval.high - interval.mean
                axes[panel].errorbar(
                    factor * interval.mean, k + offset, xerr=[[factor * below], [factor * above]],
                    color=COLOURS[controller], marker=MARKERS[controller], markersize=4.5, capsize=2, **label,
                )  # fmt: skip
                label = {}
    for axis, (heading, _) in zip(axes, PANELS, strict=True):
        axis.set_xlabel(heading)
        axis.grid(axis="x", color="#dddddd", linewidth=0.5)
        axis.spines[["top", "right"]].set_visible(False)
        for k in range(len(evaluations) - 1):
            axis.axhline(k + 0.5, color="#eeeeee", linewidth=0.6)
    axes[0].set_yticks(range(len(evaluations)), [evaluation.conditions.replace("_", " ") for evaluation in evaluations])
    axes[0].invert_yaxis()
    axes[0].set_xlim(-4.0, 104.0)
    figure.legend(loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    figure.savefig(path, dpi=150, metadata={"Software": None})


def _value(evaluation: Evaluation, controller: Controller, panel: int) -> Interval | None:
    if panel == len(PANELS) - 1:
        return evaluation.mean(controller, FORCE)
    line = next((line for line in evaluation.table2() if line.controller == controller), None)
    if line is None or not evaluation.of(TABLE2, controller=controller):
        return None
    return line.success if panel == 0 else line.lift_mm
