"""A log in Rerun: its own importer reads the file, and a blueprint says what stands where.

Imports rerun, the optional package rerun-sdk; ask `missing` first.
"""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rtstack.log.reader import read_log
from rtstack.log.viewers.scenery import FORCE_LINES
from rtstack.log.viewers.voxels import PREFIX
from rtstack.samples import SIDES

APPLICATION = "rtstack"
TIMELINE = "message_log_time"  # the robot's time; publish_time is the same
# name of the plot -> topic, message, and what of it, as Rerun's selectors spell it
_PLOTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "external force, N, and torque, Nm": ("arm", "ArmSample", (".O_F_ext_hat_K[]",)),
    "torque applied, Nm": ("arm", "ArmSample", (".tau_applied[]",)),
    "joint positions, rad": ("arm", "ArmSample", (".q[]",)),
    "force norm and margin": ("control", "ControlSample", (".force_norm", ".impact_margin")),
}


def missing() -> str:
    """Return what to install, empty where Rerun is there."""
    return "" if find_spec("rerun") else "Rerun is not installed: pip install rerun-sdk"


def blueprint(following: bool = False, sides: Sequence[str] = SIDES) -> Any:
    """Return the arrangement: scene and events beside the plots of these arms. following: it shows the newest state."""
    import rerun.blueprint as rrb

    start: dict[str, Any] = {"play_state": "following"} if following else {}
    eye = rrb.EyeControls3D(position=(1.5, -1.1, 1.2), look_target=(-0.1, 0.0, 0.35), eye_up=(0.0, 0.0, 1.0))
    scene = rrb.Spatial3DView(
        name="cell", origin="/", contents=[f"+ {PREFIX}/**", f"+ {FORCE_LINES}/**"],
        spatial_information=rrb.SpatialInformation(target_frame="world"), eye_controls=eye,
    )  # fmt: skip
    plots = [_plot(name, sides, *what) for name, what in _PLOTS.items()]
    events = rrb.TextLogView(name="events", origin="/events")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(scene, events, row_shares=[4, 1]), rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", **start), auto_views=False,
    )  # fmt: skip


def _plot(name: str, sides: Sequence[str], topic: str, message: str, selectors: tuple[str, ...]) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    overrides: Any = {
        f"/{side}/{topic}": [
            rr.SeriesLines.from_fields(names=[f"{side} {selector.strip('.[]')}"]).visualizer(mappings=[
                VisualizerComponentMapping("Scalars:scalars", ComponentSourceKind.SourceComponent,
                                           source_component=f"rtstack.{message}:message", selector=selector)
            ])
            for selector in selectors
        ]
        for side in sides
    }  # fmt: skip
    contents = [f"+ {path}" for path in overrides]
    legend = rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(name=name, origin="/", contents=contents, overrides=overrides, plot_legend=legend)


def write_recording(log: Path, out: Path) -> None:
    """Write what Rerun makes of a log, with the blueprint, to an .rrd file that must not exist yet. Raises OSError."""
    with open(out, "xb"):  # Rerun says of a file that cannot be written only that it cannot
        pass
    _show(log, "save", out)


def show(log: Path) -> None:
    """Open Rerun's viewer, a program of its own, with a log. Raises RuntimeError where it cannot be started."""
    _show(log, "spawn")


def _show(log: Path, sink: str, *where: Path) -> None:
    """Give a log with its blueprint to a sink of Rerun's, the name of a method of its RecordingStream."""
    import rerun

    recording = rerun.RecordingStream(APPLICATION)
    getattr(recording, sink)(*where, default_blueprint=blueprint(sides=read_log(log).sides))
    recording.log_file_from_path(log)
    recording.flush()
    recording.disconnect()
