"""`rtstack plot`: curves of logs as a figure, in the style of the papers, or as a page for a browser; or the arms of a
log as they moved, as an animated picture.
"""

import json
import os
from collections.abc import Mapping, Sequence
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from rtstack.cli.progress import progress_bar
from rtstack.log.errors import LogError
from rtstack.log.writing.job import texts, values_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rtstack.figures.log_figure import FigureLog, Pane

commands = typer.Typer()
_FACTS = ("kind", "object", "controller", "displacement_mm", "seed", "success", "failure_reason", "impact_verdict",
          "average_force_norm", "peak_force_norm", "max_lift_mm", "cell", "git_commit")  # fmt: skip
_POINTS = 3000  # of each curve, for the values at the pointer: the drawing has all of them
_PAGE = files("rtstack.figures") / "page.html"


@commands.command()
def plot(
    words: Annotated[
        list[str],
        typer.Argument(metavar="LOG.mcap [SIGNAL...] [LOG.mcap...]", help="Signals by name, or a part of it."),
    ],
    html: Annotated[
        bool, typer.Option("--html", help="A page with the values at the pointer; needs no network.")
    ] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="With fonts inside, for a paper.")] = False,
    png: Annotated[bool, typer.Option("--png", help="The default.")] = False,
    svg: Annotated[bool, typer.Option("--svg")] = False,
    webp: Annotated[bool, typer.Option("--webp", help="The arms as they moved; under 1 s ten times slower.")] = False,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="By default LOG.png, here.")] = None,
    start: Annotated[float | None, typer.Option("--from", metavar="S", help="After the first sample.")] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="After the first sample.")] = None,
    impact: Annotated[bool, typer.Option("--impact", help="0.2 s before to 0.3 s after the first impact.")] = False,
    reference: Annotated[bool, typer.Option("--reference", help="Draw what is to be followed, too.")] = False,
    align: Annotated[bool, typer.Option(help="Several logs with their first impacts at one time.")] = True,
) -> None:
    """Draw curves of a log, or of up to five above each other; without signals the pads' forces and velocities."""
    from rtstack.figures.log_data import figure_log, window, with_references
    from rtstack.figures.log_figure import MOST_LOGS, aligned, draw
    from rtstack.figures.style import save
    from rtstack.log.analysis.offered import ANALYSES
    from rtstack.log.analysis.signals import DEFAULT, matching, signals

    known = {"html": html, "pdf": pdf, "png": png, "svg": svg, "webp": webp}
    kinds = [kind for kind, chosen in known.items() if chosen]
    if len(kinds) > 1:
        raise typer.BadParameter(f"--{kinds[0]} and --{kinds[1]}: give one of them")
    paths = [Path(word) for word in words if word.endswith(".mcap") or Path(word).is_file()]
    if not paths:
        raise LogError(f"{words[0]}: no log among them; give one, and signals after it")
    if len(paths) > MOST_LOGS:
        raise LogError(f"{len(paths)} logs are too many in one figure, at most {MOST_LOGS}")
    named = [word for word in words if Path(word) not in paths]
    analyses = [word for word in named if word.partition(".")[0] in ANALYSES.names()]
    recorded = [word for word in named if word not in analyses]
    wanted = matching(recorded) if named else [signals()[name] for name in DEFAULT]
    if reference:
        wanted = with_references(wanted)
    target = _target(paths[0], kinds[0] if kinds else None, output)
    logs = []
    with progress_bar("reading", True) as show:
        for number, path in enumerate(paths):
            show(number / len(paths))
            logs.append(figure_log(path, wanted, analyses))
    if align:
        logs = aligned(logs)
    first, last = window(logs[0], start, end, impact)
    if target.suffix == ".webp":
        from rtstack.cli.animation import animate

        animate(paths[0], target, first, last)
        typer.echo(f"wrote {target}")
        return
    title = os.fsencode(", ".join(path.name for path in paths)).decode(errors="replace")
    figure = draw(logs, first, last, title)
    try:
        if target.suffix == ".html":
            target.write_text(_web_page(figure, logs, title, _facts(paths[0])))
        else:
            save(figure, target)
    except OSError as error:
        raise LogError(f"cannot write {target}: {error.strerror}") from None
    typer.echo(f"wrote {target}")


def _target(log: Path, kind: str | None, output: Path | None) -> Path:
    """Return where the figure goes. Raises LogError for what is none."""
    from rtstack.figures.style import FORMATS

    if output is None:
        return Path(f"{log.stem}.{kind or 'png'}")
    suffix = output.suffix.removeprefix(".")
    kinds = (*FORMATS, "html", "webp")
    if suffix not in kinds:
        raise LogError(f"{output}: a figure ends in {', '.join('.' + one for one in kinds)}")
    if kind not in (None, suffix):
        raise LogError(f"--{kind} and {output} say different things: give one of them")
    return output


def _facts(path: Path) -> Mapping[str, str]:
    """Return what the page's table says of a log: what was asked, and what came out."""
    from rtstack.log.reader import read_log

    log = read_log(path)
    trial = log.metadata.get("trial", {})
    known = {**trial, **settings(trial), **log.metadata.get("result", {})}
    return {name.replace("_", " "): known[name] for name in _FACTS if name in known}


def settings(trial: Mapping[str, str]) -> dict[str, str]:
    """Return what a trial's specification says, a line each, from its JSON; nothing where there is none."""
    specification = values_of(trial).get("specification")
    return texts(specification) if isinstance(specification, dict) else {}


def _web_page(figure: "Figure", logs: "Sequence[FigureLog]", title: str, facts: Mapping[str, str]) -> str:
    """Return the page of a figure that `draw` has made of the same logs. facts: what its table says, by name."""
    from jinja2 import Environment

    from rtstack.figures.log_figure import panes_of
    from rtstack.figures.style import save

    drawing = BytesIO()
    save(figure, drawing, "svg")
    svg = drawing.getvalue().decode()
    panes = [_values(figure, row, pane) for row, pane in enumerate(panes_of(logs))]
    data = json.dumps(panes).replace("<", "\\u003c")  # text of a log must not end the script
    template = Environment(autoescape=True).from_string(_PAGE.read_text())
    return template.render(title=title, svg=svg[svg.index("<svg") :], facts=facts, data=data)


def _values(figure: "Figure", row: int, pane: "Pane") -> dict[str, Any]:
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
