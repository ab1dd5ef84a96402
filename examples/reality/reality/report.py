"""The report: a table, a figure and, where two models are compared, a claim for each set of measurements."""

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib as mpl
import numpy as np

from reality.comparison import Comparison
from rtstack.experiments.claims import Claim, verdict_of
from rtstack.experiments.experiment import Results
from rtstack.experiments.report import Figure, Report, Section, Table
from rtstack.figures.style import COLOURS, STYLE, new_figure, save

HEADING_WIDTH = 22  # characters, of a figure's columns


def report(results: Results, comparisons: Mapping[str, Comparison], missing: Sequence[Comparison]) -> Report:
    """Return the report of all sets that are there; what is missing is a warning each."""
    parts = [_section(comparisons[row["id"]], json.loads(row["finding"])) for row in results.rows]
    return Report(
        parts, left_out=len(missing), made=[("date", datetime.now(UTC).strftime("%Y-%m-%d"))],
        summary="\n".join(claim.ours for part in parts for claim in part.claims),
        warnings=[f"{each.name} is not in the folder of data: it is {each.obtain} (licence: {each.licence})"
                  for each in missing],
    )  # fmt: skip


def _section(comparison: Comparison, finding: dict[str, Any]) -> Section:
    lines: dict[str, list[Any]] = finding["lines"]
    cells = [[name, *("-" if value is None else _cell(value) for value in values)] for name, values in lines.items()]
    note = f"{finding['samples']} samples, judged on {finding['held_out']}. Fitted: {finding['fitted']}. "
    title = f"{comparison.title}: {finding['unit']}"
    table = Table(title, ["", *finding["headings"]], cells, f"{note}Data: {comparison.obtain}; {comparison.licence}.")
    claims = []
    if finding["better"]:
        better, worse = (lines[finding[name]] for name in ("better", "worse"))
        holds = all(one <= other for one, other in zip(better, worse, strict=True) if None not in (one, other))
        ours = f"{comparison.title}: {_words(better)}, against {_words(worse)} {finding['unit']}"
        mark = f"{finding['better']}: no column has a larger error than {finding['worse']}"
        claims.append(Claim(comparison.title, "", ours, verdict_of(holds), mark=mark))
    figure = Figure(f"{comparison.name}.png", comparison.about, partial(_bars, finding=finding))
    return Section(comparison.title, claims, [table], [figure], finding, comparison.about)


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _words(values: Sequence[float | None]) -> str:
    return " ".join(_cell(value) for value in values)


@mpl.rc_context(STYLE)
def _bars(path: Path, finding: dict[str, Any]) -> None:
    """Draw the numbers of a table: a group of bars for each column, a colour for each line."""
    figure, axes = new_figure(7.5, 3.6)
    lines = finding["lines"]
    width = 0.8 / len(lines)
    places = np.arange(len(finding["headings"]))
    for k, (name, values) in enumerate(lines.items()):
        heights = [np.nan if value is None else value for value in values]
        axes[0][0].bar(
            places + (k + 0.5) * width - 0.4, heights, width, color=COLOURS[k % len(COLOURS)],
            hatch="//" * (k // len(COLOURS)), label=name,
        )  # fmt: skip
    axes[0][0].set_xticks(places, ["\n".join(wrap(heading, HEADING_WIDTH)) for heading in finding["headings"]])
    axes[0][0].set_ylabel(finding["unit"])
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    save(figure, path)
