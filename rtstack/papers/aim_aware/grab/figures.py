"""The report's figure: how long each verdict has taken."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from rtstack.figures.style import STYLE, new_figure, save
from rtstack.papers.aim_aware.grab.cases import FaultKind
from rtstack.papers.aim_aware.grab.worker import Finding

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00")  # Okabe and Ito's, one an object
HEIGHT = 0.6  # of an object's share of a row, in which its dots are spread


@mpl.rc_context(STYLE)
def figure_delays(path: Path, findings: Sequence[Finding], objects: Sequence[str]) -> None:
    """Draw the time to the verdict, a row a kind of trial, a colour an object, with the medians."""
    kinds = (None, *FaultKind)
    figure, axes = new_figure(7.5, 0.6 + 0.5 * len(kinds))
    axis = axes[0, 0]
    share = 1.0 / len(objects)
    for number, name in enumerate(objects):
        colour = COLOURS[number % len(COLOURS)]
        axis.plot([], [], "o", color=colour, markersize=4, label=name.replace("_", " "))
        for row, kind in enumerate(kinds):
            right = [f for f in findings if f.object == name and f.fault == kind and f.right]
            delays = [1e3 * f.delay_s for f in right if f.delay_s is not None]
            if not delays:
                continue
            middle = row - 0.5 + (number + 0.5) * share
            spread = middle + HEIGHT * share * (np.modf(np.arange(len(delays)) * 0.618)[0] - 0.5)
            axis.plot(delays, spread, "o", color=colour, markersize=3, alpha=0.6, markeredgewidth=0, zorder=3)
            axis.plot([np.median(delays)] * 2, middle + np.array([-0.5, 0.5]) * share, color="black", linewidth=1.0)
    axis.set_yticks(range(len(kinds)), ["good", *map(str, FaultKind)])
    axis.set_ylim(len(kinds) - 0.5, -0.5)
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("ms to the verdict (bar: median)")
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(objects))
    save(figure, path)
