"""How all figures look: Matplotlib without a display, and colours that can be told apart."""

from io import BytesIO
from pathlib import Path
from typing import IO, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.palette import MODE_STYLES
from rtstack.samples import Mode

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, safe for colour-blind eyes."""
MARKERS = "osD^vP*"
BAND_ALPHA = 0.13
STYLE: Any = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#dddddd",
    "grid.linewidth": 0.5, "lines.linewidth": 1.2, "legend.frameon": False, "savefig.dpi": 150,
    "pdf.fonttype": 42,  # whole TrueType fonts in the file: publishers refuse Matplotlib's Type 3
    "svg.hashsalt": "rtstack",  # else each run has other ids
}  # fmt: skip
FORMATS = ("pdf", "svg", "png")
# what a file would say of the program and of the time at which it was made
_UNSAID = {"pdf": ("Creator", "Producer", "CreationDate"), "svg": ("Creator", "Date"), "png": ("Software",)}


class ShownFigure(Figure):
    """A figure that a notebook shows; Matplotlib's own needs pyplot for that."""

    def _repr_png_(self) -> bytes:
        picture = BytesIO()
        save(self, picture, "png")
        return picture.getvalue()


def new_figure(width: float, height: float, **grid: Any) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of so many inches and its axes, always a matrix."""
    figure = ShownFigure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(squeeze=False, **grid)


def save(figure: Figure, target: Path | IO[bytes], form: str | None = None) -> None:
    """Write a figure, without saying by what: the same figure is the same file. form: of FORMATS, else the suffix."""
    if form is None:
        form = target.suffix[1:] if isinstance(target, Path) else "png"
    with mpl.rc_context(STYLE):
        figure.savefig(target, format=form, metadata=dict.fromkeys(_UNSAID[form]))


def mode_bands(axis: Axes, t: Array, mode: NDArray[np.int64], shown: tuple[Mode, ...]) -> None:
    """Shade the modes behind a plot. t, mode (n,): the mode at each time, in the axis' unit; shown: which of them."""
    edges = np.flatnonzero(np.diff(mode)) + 1
    for start, end in zip([0, *edges], [*edges, len(mode) - 1], strict=True):
        if mode[start] in shown and end > start:
            mode_band(axis, float(t[start]), float(t[end]), Mode(int(mode[start])))


def mode_band(axis: Axes, start: float, end: float, mode: Mode) -> None:
    axis.axvspan(start, end, color=MODE_STYLES[mode].colour, alpha=BAND_ALPHA, linewidth=0, zorder=0)
