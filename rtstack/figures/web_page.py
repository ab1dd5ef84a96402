"""A figure as one HTML file that needs no network: the drawing as SVG, the values at the pointer, and a table of what
was asked and came out.
"""

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from io import BytesIO
from typing import Any

import numpy as np
from jinja2 import Environment
from matplotlib.figure import Figure

from rtstack.figures.log_figure import FigureLog, Pane, panes_of
from rtstack.figures.style import save

_POINTS = 3000  # of each curve, for the values at the pointer: the drawing has all of them
_PAGE = files("rtstack.figures") / "page.html"


def web_page(figure: Figure, logs: Sequence[FigureLog], title: str, facts: Mapping[str, str]) -> str:
    """Return the page of a figure that `draw` has made of the same logs. facts: what its table says, by name."""
    drawing = BytesIO()
    save(figure, drawing, "svg")
    svg = drawing.getvalue().decode()
    panes = [_values(figure, row, pane) for row, pane in enumerate(panes_of(logs))]
    data = json.dumps(panes).replace("<", "\\u003c")  # text of a log must not end the script
    template = Environment(autoescape=True).from_string(_PAGE.read_text())
    return template.render(title=title, svg=svg[svg.index("<svg") :], facts=facts, data=data)


def _values(figure: Figure, row: int, pane: Pane) -> dict[str, Any]:
    """Return where a pane is in the drawing, as shares of its size, and what its curves are."""
    axis = figure.axes[row]
    box, (start_s, end_s) = axis.get_position(), axis.get_xlim()
    curves = []
    for line in pane.lines:
        inside = np.flatnonzero((line.t_s >= start_s) & (line.t_s <= end_s))
        rows = inside[:: max(1, len(inside) // _POINTS)]
        values = [float(f"{value:.4g}") if np.isfinite(value) else None for value in line.values[rows].tolist()]
        times = [round(t_s, 4) for t_s in line.t_s[rows].tolist()]
        curves.append({"label": line.label, "colour": line.colour, "t": times, "y": values})
    place = {"left": box.x0, "right": box.x1, "top": 1.0 - box.y1, "bottom": 1.0 - box.y0}
    return {**place, "from": start_s, "to": end_s, "label": pane.label, "curves": curves}
