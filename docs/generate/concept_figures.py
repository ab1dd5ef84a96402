"""The figures of the concepts, drawn from runs of the code that they explain."""

import io
import tempfile
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from concept_runs import demonstrate, follow
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtstack.cells import load_description
from rtstack.impact_map import impact_map, load_scene
from rtstack.log.reader import Log
from rtstack.monitor.records import Verdict
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.references.acceptance import Acceptance
from rtstack.samples import SIDES, Mode
from rtstack.trials.extraction import Extraction, extract

COLOURS = {"left": "#1f77b4", "right": "#d95f02"}
BEFORE_S, AFTER_S = 0.25, 0.35  # of the nominal impact
NARROW_IN, WIDE_IN = 2.6, 7.2
# text as text, and the same file from the same data
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "rtstack",
    "font.size": 9.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
}


@cache  # a site that is served is built again and again
def concept_figures() -> dict[str, str]:
    """Return file name -> SVG."""
    with tempfile.TemporaryDirectory() as folder, mpl.rc_context(STYLE):
        reference = Path(folder) / "ref.mcap"
        demonstrate(reference)
        extraction = extract(reference, load_description(None)[0], Acceptance())
        proposed = follow(reference, Controller.PROPOSED, "rice_box", -30.0)
        without = follow(reference, Controller.NO_REFERENCE_SPREADING, "rice_box", -30.0)
        lighter = follow(reference, Controller.PROPOSED, "parcel", 0.0)
        return {
            "extension.svg": _extension(extraction),
            "interim.svg": _interim(proposed),
            "effort.svg": _effort(proposed, without),
            "monitor.svg": _monitor(proposed, lighter),
            "impact_map.svg": _impact_map(),
        }


def _figure(rows: int) -> tuple[Figure, list[Axes]]:
    figure = Figure((WIDE_IN, NARROW_IN if rows == 1 else 0.75 * rows * NARROW_IN), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, list(axes[:, 0])


def _svg(figure: Figure) -> str:
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def _extension(made: Extraction) -> str:
    figure, (velocity, force) = _figure(2)
    t_ms = (np.array(made.t_s) - (made.nominal_impact_s or 0.0)) * 1e3
    for axes, curves in ((velocity, made.velocity), (force, made.force)):
        curve = curves["left"]
        axes.plot(t_ms, curve.recorded, color="0.7", lw=2.0, label="recorded")
        axes.plot(t_ms, curve.ante, color="#1b9e77", label="ante-impact reference")
        axes.plot(t_ms, curve.post, color="#7570b3", label="post-impact reference")
        axes.axvspan(-made.exclusion_s * 1e3, made.exclusion_s * 1e3, color="0.9", lw=0)
    velocity.set_ylabel("velocity, m/s")
    force.set_ylabel("feedforward, N")
    force.set_xlabel("time since the nominal impact, ms (left pad, along y; grey: replaced)")
    velocity.legend(loc="center left")
    return _svg(figure)


def _interim(log: Log) -> str:
    figure, (weight, velocity) = _figure(2)
    rows, t_ms = _around_impact(log)
    control = log.topic("/left/control")[rows]
    weight.plot(t_ms, control["gamma"], color="k", label=r"$\gamma$")
    interim = t_ms[control["mode"] == Mode.INTERIM]
    for axes in (weight, velocity):
        axes.axvspan(interim[0], interim[-1], color="#fff2cc", lw=0)
    for side in SIDES:
        arm, reference = log.topic(f"/{side}/control")[rows], COLOURS[side]
        pressing = np.linalg.norm(log.topic(f"/{side}/arm")[rows]["O_F_ext_hat_K"][:, :3], axis=1)
        weight.plot(t_ms, pressing / 100.0, color=reference, lw=0.8, label=f"{side} pad's force, 100 N")
        velocity.plot(t_ms, arm["twist_ref"][:, 1], color=reference, label=f"{side} reference")
    weight.legend(loc="upper left")
    velocity.set_ylabel("velocity along y, m/s")
    velocity.set_xlabel("time since the nominal impact, ms (box displaced by 30 mm; yellow: interim mode)")
    velocity.legend(loc="upper right")
    return _svg(figure)


def _effort(proposed: Log, without: Log) -> str:
    figure, (axes,) = _figure(1)
    for log, colour, label in ((without, "#d62728", "no_reference_spreading"), (proposed, "#1b9e77", "proposed")):
        rows, t_ms = _around_impact(log)
        axes.plot(t_ms, log.topic("/left/control")[rows]["force_norm"], color=colour, label=label)
    axes.set_ylabel("norm of the wrenches, (33)")
    axes.set_xlabel("time since the nominal impact, ms (box displaced by 30 mm)")
    axes.legend(loc="upper left")
    return _svg(figure)


def _monitor(expected: Log, other: Log) -> str:
    figure, (axes,) = _figure(1)
    for log, colour, label in ((expected, "#1b9e77", "rice box, displaced"), (other, "#d62728", "a lighter parcel")):
        rows, t_ms = _around_impact(log, after_s=0.6)
        control = log.topic("/left/control")[rows]
        axes.plot(t_ms, np.clip(control["pair_margin"], -1.0, 1.0), color=colour, label=label)
        decided = np.flatnonzero(control["pair_verdict"] != Verdict.NONE)
        if len(decided):
            verdict = Verdict(int(control["pair_verdict"][decided[0]])).name.lower()
            place = (t_ms[decided[0]], float(np.clip(control["pair_margin"][decided[0]], -1.0, 1.0)))
            axes.annotate(verdict, place, xytext=(4, 4), textcoords="offset points", color=colour)
            axes.plot(*place, "o", color=colour)
    axes.axhline(0.0, color="k", lw=0.8)
    axes.set_ylabel("margin of the pair")
    axes.set_xlabel("time since the nominal impact, ms (below 0: not as demonstrated)")
    axes.legend(loc="lower left")
    return _svg(figure)


def _impact_map() -> str:
    with as_file(files("deploy.impacts") / "grab.toml") as path:
        result = impact_map(load_scene(path))
    figure, axes = _figure(2)
    names = ("left", "right", "rice_box")
    steps = {"before": None, "single step": result.single_step, "converged": result.converged}
    for axis, ax in ((1, axes[0]), (2, axes[1])):
        for k, (label, step) in enumerate(steps.items()):
            twists = [result.twist_before(name) if step is None else result.twist(name, step) for name in names]
            ax.bar(np.arange(3) + 0.27 * (k - 1), [twist[axis] for twist in twists], 0.25, label=label)
        ax.set_ylabel(f"velocity along {'xyz'[axis]}, m/s")
    axes[1].set_xticks(range(3), names)
    axes[0].legend()
    return _svg(figure)


def _around_impact(log: Log, after_s: float = AFTER_S) -> tuple[slice, np.ndarray]:
    """Return the rows around the nominal impact, and their times since it in ms."""
    t_s = (log.topic("/left/control")["t_ns"] - log.start_ns) * 1e-9
    since = t_s - float(log.metadata["trial"]["nominal_impact_s"])
    rows = slice(*np.searchsorted(since, (-BEFORE_S, after_s)).tolist())
    return rows, since[rows] * 1e3
