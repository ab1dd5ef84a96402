"""Figures 3, 4, 6, 7 and 8 of the collision-monitoring paper, from this study's simulations."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from rtstack.figures.style import STYLE, new_figure, save
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Verdict
from rtstack.papers.aim_aware.claims import Bands
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.outline import Column
from rtstack.papers.aim_aware.planar.plan import Plan

ANTE, POST, MEASURED, RED, BAND = "#009E73", "#E69F00", "#0072B2", "#D55E00", "#0072B2"
BEFORE_MS, AFTER_MS = 60.0, 160.0


def _t_ms(impact: Impact) -> NDArray[np.float64]:
    return 1e-6 * (impact.ticks["t_ns"] - impact.t_d_ns)


@mpl.rc_context(STYLE)
def figure3(path: Path, impact: Impact[Plan]) -> None:
    """Draw the ante- and post-impact references, dashed where extended, and the measured motion."""
    figure, axes = new_figure(9.0, 4.2, nrows=2, ncols=3, sharex=True)
    t_ms = _t_ms(impact)
    shown = (t_ms > -200.0) & (t_ms < 200.0)
    rows = ((0, "x", (1e3, 1e3, 180.0 / np.pi), ("x, mm", "y, mm", "phi, deg")),
            (1, "dx", (1.0, 1.0, 1.0), ("x rate, m/s", "y rate, m/s", "phi rate, rad/s")))  # fmt: skip
    for row, name, factors, labels in rows:
        for i, (factor, label) in enumerate(zip(factors, labels, strict=True)):
            axis = axes[row][i]
            axis.plot(t_ms[shown], factor * impact.ticks[name][shown, i], color=MEASURED, linewidth=1.0, label="arm")
            for reference, colour, text, meant in (
                (impact.plan.ante, ANTE, "ante-impact", t_ms <= 0.0),
                (impact.plan.post, POST, "post-impact", t_ms >= 0.0),
            ):
                values = factor * reference[row][:, i]
                axis.plot(t_ms[shown & meant], values[shown & meant], color=colour, label=text)
                axis.plot(t_ms[shown & ~meant], values[shown & ~meant], color=colour, linestyle="--")
            axis.set_title(label, loc="left", fontsize=9)
            if row == 1:
                axis.set_xlabel("time from $t_d$, ms")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    save(figure, path)


@mpl.rc_context(STYLE)
def figure4(path: Path, impact: Impact[Plan], parameters: MonitorParameters) -> None:
    """Draw the residual and its numerical derivative with the bound r_b, and the corners' forces below."""
    trace = impact.trace(parameters)
    figure, axes = new_figure(7.5, 5.2, nrows=3, sharex=True)
    t_ms = _t_ms(impact)
    shown = (t_ms > -BEFORE_MS) & (t_ms < AFTER_MS)
    hits = t_ms[shown & (trace["impact"] != 0)]
    for axis, values, label in zip(
        axes[:, 0], (trace["residual"], trace["rate"], impact.ticks["forces"]),
        ("residual r, Nm", r"$\Delta r/\Delta t$, Nm/s", "corners' forces, N"), strict=True,
    ):  # fmt: skip
        for i in range(values.shape[1]):
            axis.plot(t_ms[shown], values[shown, i], label=f"{'corner' if values.shape[1] == 2 else 'joint'} {i + 1}")
        for t in hits:
            axis.axvline(t, color="#999999", linewidth=0.8, linestyle=":")
        axis.set_ylabel(label)
        axis.legend(loc="upper right", fontsize=8)
    for sign in (-1.0, 1.0):
        axes[1][0].axhline(sign * parameters.residual_rate_nm_s[0], color=RED, linestyle="--")
    axes[2][0].set_xlabel("time from $t_d$, ms (dotted: impacts)")
    save(figure, path)


@mpl.rc_context(STYLE)
def figure6(
    path: Path, impacts: Sequence[Impact], parameters: MonitorParameters, joints: Sequence[int] = (0, 1, 2)
) -> None:
    """Draw the velocity error and its envelope; blue: used for the verdict; red: zero lies outside."""
    figure, axes = new_figure(9.0, 5.4, nrows=len(joints), ncols=len(impacts), sharex="col", sharey="row")
    for column, impact in enumerate(impacts):
        trace, t_ms = impact.trace(parameters), _t_ms(impact)
        shown = (t_ms > -BEFORE_MS) & (t_ms < AFTER_MS + 60.0)
        since = trace["t_ns"] - trace["t_impact_ns"]
        used = (trace["impacts"] > 0) & (since >= 1e6 * parameters.delay) & (since <= 1e9 * parameters.horizon_s)
        last = trace["t_impact_ns"] == trace["t_impact_ns"][-1]  # earlier impacts' windows were given up
        for row, i in enumerate(joints):
            axis = axes[row][column]
            low, high = (trace[name][:, i] for name in ("lower", "upper"))
            low, high = low - parameters.velocity_rad_s, high + parameters.velocity_rad_s
            axis.plot(t_ms[shown], trace["error"][shown, i], color="#56B4E9", linewidth=0.9)
            axis.fill_between(t_ms, low, high, where=shown & used & last, color=BAND, alpha=0.2, linewidth=0)
            for edge, outside in ((low, low > 0.0), (high, high < 0.0)):
                axis.fill_between(t_ms, 0.0, edge, where=shown & used & last & outside, color=RED, alpha=0.6)
            axis.axhline(0.0, color="#555555", linewidth=0.7)
            if column == 0:
                axis.set_ylabel(f"joint {i + 1}, rad/s")
        verdict = Verdict(trace["verdict"][-1]).name.lower()
        axes[0][column].set_title(f"{impact.case.inclination_deg:+g} deg: {verdict}", loc="left", fontsize=9)
        axes[-1][column].set_xlabel("time from $t_d$, ms")
    save(figure, path)


@mpl.rc_context(STYLE)
def shares(path: Path, groups: Mapping[str, Mapping[str, Bands]], columns: Mapping[str, Column]) -> None:
    """Draw the share of expected impacts by inclination: Figures 7 and 8. groups: title -> bands, a column each."""
    figure, axes = new_figure(9.5, 1.87 * len(columns), nrows=len(columns), ncols=len(groups), sharex=True)
    for axis, (title, name) in zip(axes.T.flat, product(groups, columns), strict=True):
        found, column = groups[title][name], columns[name]
        degrees = list(found.shares)
        half = 0.5 * min(np.diff(degrees), default=1.0)
        for deg in found.certain:
            axis.axvspan(deg - half, deg + half, color=BAND, alpha=0.15, linewidth=0)
        axis.bar(degrees, [100.0 * share for share in found.shares.values()], width=1.6 * half, color=BAND)
        for band, style in ((column.mirrored().always_deg, ":"), (column.always_deg, "--")):
            for edge, sign in zip(band, (-1.0, 1.0), strict=True):
                axis.axvline(edge + sign * half, color=RED, linestyle=style, linewidth=1.0)
        axis.set_ylabel(f"({name}) expected, %")
        axis.set_ylim(0.0, 105.0)
        axis.set_xticks(degrees)
        axis.tick_params(axis="x", labelsize=6)
    for axis, title in zip(axes[0], groups, strict=True):
        axis.set_title(title, loc="left", fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("inclination of the surface, deg", fontsize=8)
    save(figure, path)
