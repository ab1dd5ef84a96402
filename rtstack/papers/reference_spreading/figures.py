"""The paper's figures 5, 8, 10 and 11, from recordings, logs and results. Matplotlib without a display."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from textwrap import shorten

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rtstack.control.parameters import ControlParameters
from rtstack.experiments.claims import Claim, ClaimStatus
from rtstack.experiments.generic import draw_means
from rtstack.figures.style import BAND_ALPHA, STYLE, mode_bands, new_figure, save
from rtstack.log.reader import read_log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.palette import MODE_STYLES
from rtstack.papers.reference_spreading.controllers import COLOURS, MARKERS, NAMES, Controller, name_of
from rtstack.papers.reference_spreading.evaluation import Evaluation
from rtstack.papers.reference_spreading.measures import Passage, hit_arm, passage
from rtstack.papers.reference_spreading.plan import Hands, combination_name
from rtstack.references.recording import Recording
from rtstack.references.spreading import ExtendedReference
from rtstack.samples import Mode
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS, OBJECT_TOPIC, TIMING_TOPIC
from rtstack.trials.scoring import FORCE_WINDOW_S

BANDS = (Mode.ANTE_IMPACT, Mode.INTERIM, Mode.POST_IMPACT)
BEFORE_S, AFTER_S = 0.2, 0.3
MARGIN_S = 0.01  # more that is read: a velocity is taken over neighbouring ticks
INWARD = (-1.0, 1.0)  # the sign of the world's y towards the object, of the left and the right arm
SIDE = ("left", "right")


@dataclass(frozen=True, slots=True)
class LoggedTrial:
    """A trial around its nominal impact, as its log has it. passage: without the gaps, t_s since the trial's start."""

    controller: str
    columns: Columns
    passage: Passage
    detected_s: float | None


def logged_trial(
    path: Path, controller: str, object_name: str, description: CellDescription, nominal_s: float
) -> LoggedTrial:
    """Read of a trial's log what the figures show: 0.5 s of five or more. Raises LogError."""
    log = read_log(path)
    start_ns = log.first_ns(ARM_TOPICS[0]) or 0
    from_s, to_s = nominal_s - BEFORE_S - MARGIN_S, nominal_s + AFTER_S + MARGIN_S
    topics = (*ARM_TOPICS, *CONTROL_TOPICS, TIMING_TOPIC, OBJECT_TOPIC)
    records = log.between(topics, start_ns + round(1e9 * from_s), start_ns + round(1e9 * to_s))
    columns = Columns.read(records.__getitem__)
    seen = passage(replace(columns, object=columns.object[:0]), description, object_name)
    seen = replace(seen, t_s=(columns.arm[0]["t_ns"] - start_ns) * 1e-9)
    text = log.metadata.get("result", {}).get("detected_impact_time_s", "null")
    detected_s = None if text == "null" else float(text)
    return LoggedTrial(controller, columns, seen, detected_s)


@mpl.rc_context(STYLE)
def figure5(path: Path, recording: Recording, reference: ExtendedReference) -> None:
    """Draw what was recorded and the extended references: position, velocity and desired force towards the object."""
    figure, axes = new_figure(9.0, 2.9, ncols=3)
    arm = hit_arm(0.0)
    sign, n = INWARD[arm], recording.points.shape[1]
    t_ms = 1e3 * (np.arange(n) * recording.period_s - recording.impact_s)
    parts = ("position", 1e3, "position, mm"), ("twist", 1.0, "velocity, m/s"), ("wrench_ff", 1.0, "desired force, N")
    exclusion_ms = 1e3 * ControlParameters().exclusion_s
    shown = (t_ms > -250.0) & (t_ms < 250.0)
    for axis, (name, factor, label) in zip(axes[0], parts, strict=True):
        recorded, ante, post = (
            sign * factor * p[arm][name][shown, 1] for p in (recording.points, reference.ante, reference.post)
        )
        axis.axvspan(-exclusion_ms, exclusion_ms, color="#eeeeee", zorder=0)
        axis.axvline(0.0, color="#555555", linestyle="--", linewidth=0.9)
        axis.plot(t_ms[shown], recorded, color="#999999", label="recorded", linewidth=2.2)
        for values, mode, word in ((ante, Mode.ANTE_IMPACT, "ante"), (post, Mode.POST_IMPACT, "post")):
            text, colour = f"{word}-impact reference", MODE_STYLES[mode].colour
            axis.plot(t_ms[shown], values, color=colour, linestyle="--", label=text)
        axis.set_xlabel("time from the impact $T_r$, ms")
        axis.set_title(label, loc="left", fontsize=9)
        axis.set_xlim(-250.0, 250.0)
        if name == "position":  # the ante-impact reference goes on through the box: leave it to leave the frame
            span = np.ptp(recorded)
            axis.set_ylim(recorded.min() - 0.4 * span, recorded.max() + 1.2 * span)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    save(figure, path)


@mpl.rc_context(STYLE)
def figure8(
    path: Path, trials: Mapping[Controller, LoggedTrial], reference: ExtendedReference, displacement_mm: float
) -> None:
    """Draw velocity and desired force, towards the object, of the arm that hits first; a column a controller."""
    figure, axes = new_figure(11.0, 5.2, nrows=2, ncols=len(trials), sharex=True, sharey="row")
    arm = hit_arm(displacement_mm)
    sign, nominal_s = INWARD[arm], reference.nominal_impact_s
    reference_ms = 1e3 * (np.arange(reference.ticks) * reference.period_s - nominal_s)
    near = (reference_ms > -1e3 * BEFORE_S) & (reference_ms < 1e3 * AFTER_S)
    for column, (controller, trial) in enumerate(trials.items()):
        seen = trial.passage
        t_ms = 1e3 * (seen.t_s - nominal_s)
        shown = (t_ms > -1e3 * BEFORE_S) & (t_ms < 1e3 * AFTER_S)
        force = sign * trial.columns.control[arm]["wrench_desired"][:, 1]
        for row, (measured, name) in enumerate(((sign * seen.velocity_y[arm], "twist"), (force, "wrench_ff"))):
            axis: Axes = axes[row][column]
            mode_bands(axis, t_ms[shown], trial.columns.control[arm]["mode"][shown], BANDS)
            for points, mode in ((reference.ante, Mode.ANTE_IMPACT), (reference.post, Mode.POST_IMPACT)):
                values = sign * points[arm][name][near, 1]
                axis.plot(reference_ms[near], values, color=MODE_STYLES[mode].colour, linestyle="--", linewidth=1.0)
            axis.plot(t_ms[shown], measured[shown], color="#222222")
            axis.axvline(0.0, color="#222222", linestyle=":", linewidth=0.9)
            if trial.detected_s is not None:
                axis.axvline(1e3 * (trial.detected_s - nominal_s), color="#222222", linestyle=":", linewidth=0.9)
            axis.set_xlim(-1e3 * BEFORE_S, 1e3 * AFTER_S)
        axes[0][column].set_title(NAMES[controller], fontsize=9)
        axes[1][column].set_xlabel("time from $T_r$, ms")
    axes[0][0].set_ylabel("velocity towards the object, m/s")
    axes[1][0].set_ylabel("desired force towards it, N")
    line = partial(Line2D, [], [])
    styles = [MODE_STYLES[mode] for mode in (Mode.ANTE_IMPACT, Mode.POST_IMPACT)]
    handles = [
        line(color="#222222", label=f"{SIDE[arm]} pad (the one hit first)"),
        *(line(color=s.colour, linestyle="--", label=f"{s.word} reference, feedforward") for s in styles),
        line(color="#222222", linestyle=":", label="detected impact, nominal impact $T_r$"),
        *(Patch(color=MODE_STYLES[m].colour, alpha=BAND_ALPHA, label=f"{MODE_STYLES[m].word} mode") for m in BANDS),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8)
    save(figure, path)


@mpl.rc_context(STYLE)
def figure10(path: Path, trials: Sequence[LoggedTrial], nominal_s: float) -> None:
    """Draw (33) around the impact: every repetition of every controller."""
    figure, axes = new_figure(7.5, 3.8)
    axis = axes[0][0]
    axis.axvspan(-1e3 * FORCE_WINDOW_S, 1e3 * FORCE_WINDOW_S, color="#f2f2f2", zorder=0)
    named: set[str] = set()
    for trial in trials:
        t_ms = 1e3 * (trial.passage.t_s - nominal_s)
        shown = (t_ms > -1e3 * BEFORE_S) & (t_ms < 1e3 * AFTER_S)
        label = None if trial.controller in named else name_of(trial.controller)
        named.add(trial.controller)
        axis.plot(t_ms[shown], trial.passage.force_norm[shown], color=COLOURS[trial.controller], alpha=0.75,
                  linewidth=0.9, label=label)  # fmt: skip
    axis.set_xlim(-1e3 * BEFORE_S, 1e3 * AFTER_S)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("time from the nominal impact $T_r$, ms (grey: the 200 ms of Figure 11)")
    axis.set_ylabel("desired force norm (33)")
    axis.legend(loc="upper left")
    save(figure, path)


@mpl.rc_context(STYLE)
def figure11(path: Path, evaluation: Evaluation, controllers: Iterable[Controller] = tuple(NAMES)) -> None:
    """Draw the mean of (33) by displacement and controller, with its 95 % intervals."""
    controllers = tuple(controllers)
    figure, axes = new_figure(7.5, 3.8)
    axis = axes[0][0]
    displacements = evaluation.displacements()
    for index, controller in enumerate(controllers):
        aside = 0.9 * (index - 0.5 * (len(controllers) - 1))
        means = [(d + aside, evaluation.mean_force(controller, d)) for d in displacements]
        colour, marker = COLOURS[controller], MARKERS[controller]
        draw_means(axis, means, color=colour, marker=marker, linewidth=1.2, label=name_of(controller))
    axis.set_xticks(displacements)
    axis.set_xlabel("displacement of the object, mm")
    axis.set_ylabel("mean desired force norm, 200 ms around $T_r$")
    axis.set_ylim(bottom=0.0)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    save(figure, path)


# Okabe and Ito's colours, with a letter each for those who see none
_DRAWN = {
    ClaimStatus.HOLDS: ("#009E73", "H"), ClaimStatus.WITHIN: ("#56B4E9", "h"),
    ClaimStatus.UNDECIDED: ("#eeeeee", "?"), ClaimStatus.DIFFERS: ("#D55E00", "D"),
}  # fmt: skip


def figure_hands(path: Path, hands: Hands, claims: Mapping[str, Sequence[Claim]]) -> None:
    """Draw a map for each claim: depth x time of the hand, a panel for each law and pad."""
    keys = list(dict.fromkeys((claim.where, claim.says) for each in claims.values() for claim in each))
    panels = list(product(hands.law_inertia, hands.pad_stiffness))
    figure = Figure(figsize=(2.2 * len(panels) + 3.0, 1.5 * len(keys) + 1.0), layout="constrained")
    grid = figure.subplots(len(keys), len(panels), sharex=True, sharey=True, squeeze=False)
    for row, key in zip(grid, keys, strict=True):
        for axis, (law, pad) in zip(row, panels, strict=True):
            for (i, depth), (j, stop) in product(enumerate(hands.depth_m), enumerate(hands.stop_s)):
                of_hand = claims.get(combination_name(law, pad, depth, stop), ())
                found = {(claim.where, claim.says): claim.verdict for claim in of_hand}
                colour, letter = _DRAWN[found.get(key, ClaimStatus.UNDECIDED)]
                axis.fill([i, i + 1, i + 1, i], [j, j, j + 1, j + 1], color=colour, linewidth=0.0)
                axis.text(i + 0.5, j + 0.5, letter, ha="center", va="center", fontsize=8)
            axis.set_xticks([i + 0.5 for i in range(len(hands.depth_m))], [f"{1e3 * d:g}" for d in hands.depth_m])
            axis.set_yticks(
                [j + 0.5 for j in range(len(hands.stop_s))], [f"{1e3 * s:g} ms" if s else "even" for s in hands.stop_s]
            )
        row[0].set_ylabel(f"{key[0]}", fontsize=8)
        row[0].set_title(shorten(key[1], 110, placeholder=" ..."), loc="left", fontsize=7)
    for axis, (law, pad) in zip(grid[-1], panels, strict=True):
        axis.set_xlabel(f"depth, mm\n{law}, {1e-3 * pad:g} kN/m", fontsize=8)
    figure.suptitle(
        "H holds   h holds, within the intervals   ? cannot be told   D differs;  upwards: time from surface to rest",
        fontsize=8,
    )
    figure.savefig(path, dpi=150, metadata={"Software": None})
