"""How all figures look: Matplotlib without a display, and colours that can be told apart."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

# Okabe and Ito's colours, safe for colour-blind eyes
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
MARKERS = "osD^vP*"
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "savefig.dpi": 150,
}


def new_figure(width: float, height: float, **grid: Any) -> tuple[Figure, NDArray]:
    """Return a figure of so many inches and its axes, always a matrix."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(squeeze=False, **grid)


def save(figure: Figure, path: Path) -> None:
    """Write a figure, without saying by what: the same figure is the same file."""
    figure.savefig(path, metadata={"Software": None})
