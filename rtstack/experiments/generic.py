"""The table and the figure that any rows can have: the mean of a column, by the values of others."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes

from rtstack.experiments.claims import shown
from rtstack.experiments.report import Figure, Table
from rtstack.experiments.statistics import Interval, plain_mean, proportion
from rtstack.figures.style import COLOURS, MARKERS, STYLE, new_figure, save

Row = Mapping[str, Any]


def mean_table(title: str, rows: Sequence[Row], by: Sequence[str], columns: Mapping[str, str]) -> Table:
    """Return a line for each combination of values of the columns `by`: how many rows, and the mean of each column with
    its 95 % interval. columns: name -> heading. A column of truth values is shown as a share, %.
    """
    shares = {name for name in columns if any(isinstance(row[name], bool) for row in rows)}
    lines = []
    for key, group in _groups(rows, by).items():
        means = ((name, _mean(group, name)) for name in columns)
        cells = [shown(mean, " %", 0, 100.0) if name in shares else shown(mean, "", 3) for name, mean in means]
        lines.append([*map(_word, key), str(len(group)), *cells])
    headings = (*(name.replace("_", " ") for name in by), "n", *columns.values())
    return Table(title, headings, lines, numbers_from=len(by))


def mean_figure(file: str, caption: str, rows: Sequence[Row], x: str, series: str, column: str, label: str) -> Figure:
    """Return a figure of the mean of `column` over `x`, with 95 % intervals, a line for each of `series`."""

    @mpl.rc_context(STYLE)
    def draw(path: Path) -> None:
        figure, axes = new_figure(7.5, 3.8)
        axis = axes[0][0]
        places = sorted({row[x] for row in rows}, key=lambda value: (isinstance(value, str), value))
        numeric = all(isinstance(place, int | float) for place in places)
        for number, (name, group) in enumerate(_groups(rows, (series,)).items()):
            means = [
                (float(place) if numeric else float(index), _mean([row for row in group if row[x] == place], column))
                for index, place in enumerate(places)
            ]
            colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
            draw_means(axis, means, color=colour, marker=marker, label=_word(name[0]))
        if numeric:
            axis.set_xticks(places)
        else:
            axis.set_xticks(range(len(places)), [_word(place) for place in places])
        axis.set_xlabel(x.replace("_", " "))
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0.0)
        figure.legend(loc="outside lower center", ncols=4, fontsize=8)
        save(figure, path)

    return Figure(file, caption, draw)


def draw_means(axis: Axes, means: Iterable[tuple[float, Interval | None]], **how: Any) -> None:
    """Draw (x, mean) with 95 % intervals, those that there are. how: colour, marker, label for Matplotlib."""
    known = [(at, mean) for at, mean in means if mean is not None]
    below = [0.0 if mean.low is None else mean.mean - mean.low for _, mean in known]
    above = [0.0 if mean.high is None else mean.high - mean.mean for _, mean in known]
    x, y = [at for at, _ in known], [mean.mean for _, mean in known]
    axis.errorbar(x, y, yerr=[below, above], markersize=5, capsize=3, **how)


def _groups(rows: Sequence[Row], by: Sequence[str]) -> dict[tuple[Any, ...], list[Row]]:
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return groups


def _mean(rows: Sequence[Row], name: str) -> Interval | None:
    values = [row[name] for row in rows if row[name] is not None]
    if values and all(isinstance(value, bool) for value in values):
        return proportion(sum(values), len(values))
    return plain_mean(values) if values else None


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")
