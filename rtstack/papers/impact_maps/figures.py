"""Figures 6 to 9 of the impact-map paper: signals of one set of trials, and its fit. Matplotlib without a display."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from rtstack.figures.style import STYLE, new_figure, save
from rtstack.impact_map import ReflectedInertia
from rtstack.papers.impact_maps.evaluation import NAMES, Cell
from rtstack.papers.impact_maps.feedback import FeedbackSignal

# Okabe and Ito's colours, safe for colour-blind eyes
COLOURS = ("#56B4E9", "#009E73", "#000000", "#E69F00", "#D55E00")
INERTIA = {
    ReflectedInertia.B_THETA: ("#0072B2", "-"),
    ReflectedInertia.B: ("#D55E00", "--"),
    ReflectedInertia.NONE: ("#009E73", ":"),
}


@mpl.rc_context(STYLE)
def signals(path: Path, by_scale: Mapping[float, Sequence[FeedbackSignal]]) -> None:
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
def fit(path: Path, cell: Cell) -> None:
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
    for kind, (colour, style) in INERTIA.items():
        error = cell.error_percent(kind)
        off = "" if error is None else f" ({error:+.2f} %)"
        axis.axvline(cell.predicted[kind], color=colour, linestyle=style, label=f"predicted, {NAMES[kind]}{off}")
    axis.axhline(0.0, color="#555555", linewidth=0.6)
    axis.set_xlabel("post-impact velocity of the reference, m/s")
    axis.set_ylabel("net feedback (29), m/s")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    save(figure, path)
