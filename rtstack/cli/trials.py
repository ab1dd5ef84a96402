"""`rtstack teach`, `rtstack trial` and `rtstack play`; `rtstack demo`, which goes the whole way once."""

import os
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.base.extras import advice
from hal.displacement import Displacement
from rtstack.cli import options
from rtstack.cli.plot import plot
from rtstack.cli.review import review
from rtstack.log.errors import LogError
from rtstack.samples import LawInertia, Reaction
from rtstack.trials.controllers import (
    CONTROLLERS,
    DEFAULT,
    DEFAULT_DETECTOR,
    DETECTORS,
    Point,
    controller_names,
    detector_names,
    known,
)
from rtstack.trials.specification import DemonstrationSpecification, PlaybackSpecification, TrialSpecification

if TYPE_CHECKING:
    from rtstack.trials.result import TrialResult

commands = typer.Typer()
OBJECT, DISPLACEMENT_MM = "rice_box", -30.0  # of the demo
Asked = dict[str, Any] | None  # filled by asks_for


def _known(point: Point) -> Callable[[str], str]:
    def check(name: str) -> str:
        try:
            return known(point, name)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return check


ControllerChoice = Annotated[
    str,
    typer.Option(
        metavar=f"[{'|'.join(controller_names())}]",
        callback=_known(CONTROLLERS),
        help="The proposed controller, a baseline, contact_completion, or one of another package.",
    ),
]
DetectorChoice = Annotated[
    str,
    typer.Option(
        metavar=f"[{'|'.join(detector_names())}]",
        callback=_known(DETECTORS),
        help="What detects impacts, and so changes the mode: Appendix B's, or one of another package.",
    ),
]
Law = Annotated[
    LawInertia | None,
    typer.Option(
        "--law-inertia", help="Mass matrix of the controller's law: M of the links, or M+B_theta; default: the cell's."
    ),
]


@commands.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="A new folder, for both logs.")] = Path("demo"),
    browser: Annotated[bool, typer.Option(help="Open the impact's page, where there is a display.")] = True,
) -> None:
    """The whole way once, simulated: a demonstration, a trial of it with the object displaced, its review."""
    recording, log = out / "demonstration.mcap", out / "trial.mcap"
    try:
        out.mkdir()
    except OSError as error:
        raise LogError(f"cannot make the folder {out}: {error.strerror}; choose another one with --out") from error
    typer.echo(f"1. A scripted hand leads both arms to the object {OBJECT}, which they grab by hitting it.")
    teach(output=recording, object=OBJECT)
    typer.echo(f"\n2. A trial follows that recording; the object is {-DISPLACEMENT_MM:.0f} mm nearer to the right arm.")
    trial(reference=recording, object=OBJECT, displacement_mm=DISPLACEMENT_MM, log=log)
    typer.echo("\n3. The review of its log.")
    review(log)
    typer.echo("\n4. Its impact, as a page.")
    _show_impact(log, out / "impact.html", browser)
    typer.echo("\nNext: `rtstack up` starts the console.")


def _show_impact(log: Path, page: Path, browser: bool) -> None:
    try:
        plot([str(log)], html=True, output=page, impact=True)
    except ModuleNotFoundError as error:
        if not (lacking := advice(error.name)):
            raise
        typer.echo(f"left out: {lacking}")
        return
    # a browser that needs no display would take the terminal
    displayed = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not (browser and displayed and webbrowser.open(page.absolute().as_uri())):
        typer.echo(f"open it in a browser: {page.absolute().as_uri()}")


@commands.command()
@options.asks_for(DemonstrationSpecification, "speed_m_s", "squeeze_m", "squeeze_s")
def teach(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The recording to write.")],
    object: options.ObjectName = "rice_box",
    variation: Annotated[int, typer.Option(help="Number of the demonstration.", min=0)] = 0,
    seed: options.Seed = 0,
    speed: Annotated[
        float | None,
        typer.Option(help="Speed of the pads at the object, m/s, if not the variation's.", min=0.1, max=0.6),
    ] = None,
    law_inertia: Law = None,
    asked: Asked = None,
    cell: options.CellKind = "direct",
    profile: options.Profile = None,
    cell_file: options.CellFile = None,
    json: options.Json = False,
) -> None:
    """Record a scripted demonstration through the teleoperation path."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.trials.demonstration import prepare_demonstration

    specification = DemonstrationSpecification(**asked or {}, speed_m_s=speed)
    what, bar = f"demonstration of {specification.object}", "demonstration" * (not json)
    host = Terminal.of(cell, profile, cell_file, what, bar=bar, log_path=output)
    result = host.run(prepare_demonstration(specification, host.description))
    line = f"demonstration failed: {result.failure_reason}"
    if result.success:
        lift = "the object was never seen" if result.max_lift_mm is None else f"lifted {result.max_lift_mm:.0f} mm"
        line = (
            f"recorded {result.log}: {result.object}, variation {result.variation}, impact at "
            f"{result.detected_impact_time_s:.3f} s, {lift}"
        )
    report(result, json, line)


@commands.command()
@options.asks_for(TrialSpecification, "safety")
def trial(
    reference: Annotated[Path, typer.Option(metavar="REC.mcap", help="Made by `rtstack teach` or `rtstack plan`.")],
    controller: ControllerChoice = DEFAULT,
    object: Annotated[
        str | None, typer.Option("--object", help="An object of the cell; by default the reference's.")
    ] = None,
    displacement_mm: options.ShiftY = 0.0,
    displacement_x_mm: options.ShiftX = 0.0,
    yaw_deg: options.Yaw = 0.0,
    seed: options.Seed = 0,
    law_inertia: Law = None,
    detector: DetectorChoice = DEFAULT_DETECTOR,
    asked: Asked = None,
    log: options.LogOut = None,
    cell: options.CellKind = "direct",
    profile: options.Profile = None,
    cell_file: options.CellFile = None,
    safety: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML with a table [safety]: limits that this trial tightens.")
    ] = None,
    friction: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Friction, made by `rtstack identify-friction`.")
    ] = None,
    reaction: Annotated[
        Reaction, typer.Option(help="What an impact leads to that was not meant; continue: a mark in log and result.")
    ] = Reaction.CONTINUE,
    monitor: Annotated[
        Path | None, typer.Option(metavar="TOML", help="The monitor's parameters, made by `rtstack tune-monitor`.")
    ] = None,
    faults: options.Faults = None,
    whole_reference: Annotated[
        bool, typer.Option("--whole-reference", help="Attach the reference to the log; else it is named by its digest.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Run one trial: follow a recording through the impact."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.trials.monitoring import load_tuning
    from rtstack.trials.object import object_of
    from rtstack.trials.tightening import load_tightening
    from rtstack.trials.trial import prepare_trial

    given: dict[str, Any] = {"object": object or object_of(reference)} | (asked or {})
    specification = TrialSpecification(**given)
    what, bar = f"trial of {specification.object}", f"trial, {specification.controller}" * (not json)
    host = Terminal.of(
        cell, profile, cell_file, what, bar=bar, log_path=log, faults=faults, led=specification.shadow,
        shadow=specification.shadow,
    )  # fmt: skip
    if friction is not None:
        host.description = replace(host.description, joint_friction=friction)
    if safety is not None:
        specification = replace(specification, safety=load_tightening(safety))
    tuning = load_tuning(monitor).monitor if monitor is not None else None
    prepared = replace(prepare_trial(specification, host.description, monitor=tuning), whole_reference=whole_reference)
    if prepared.unwatched is not None:
        print(f"rtstack: not watched: {prepared.unwatched}", file=sys.stderr)
    result = host.run(prepared)
    report(result, json, _trial_line(result), ran=specification.shadow)


def _trial_line(result: "TrialResult") -> str:
    reason = result.failure_reason or ""
    outcome = "success" if result.success else reason if reason.startswith("shadow: ") else f"failed: {reason}"
    detected = result.detected_impact_time_s
    impact = "none" if detected is None else f"{detected:.3f} s"
    verdict = result.impact_verdict or "not watched"
    if result.impact_kind is not None:
        verdict += f" ({result.impact_kind}: {(result.impact_reason or '').replace('_', ' ')})"
    lift = "not observed" if result.max_lift_mm is None else f"{result.max_lift_mm:.0f} mm"
    shift = Displacement.given(result.displacement_mm, result.displacement_x_mm, result.yaw_deg)
    norm = "-" if result.average_force_norm is None else f"{result.average_force_norm:.1f}"
    python = f" (plain Python, an arm: {result.plain_python})" if result.plain_python else ""
    return (
        f"{outcome} | {result.controller}, {result.object}, {shift.in_words}, seed {result.seed} | "
        f"impact {impact} (nominal {result.nominal_impact_time_s:.3f} s), {verdict} | mean force norm {norm} | "
        f"lift {lift} | compute p50 {result.compute_us_p50:.0f} us{python} | {result.real_time_factor:.1f} x real time"
    )


@commands.command()
@options.asks_for(PlaybackSpecification, "digest", "object")
def play(
    source: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="A recording, or any other log of both arms.")],
    speed: Annotated[float, typer.Option(help="Times the log's own speed: 0.1 to 4, as far as limits allow.")] = 1.0,
    seed: options.Seed = 0,
    asked: Asked = None,
    log: options.LogOut = None,
    cell: options.CellKind = "direct",
    profile: options.Profile = None,
    cell_file: options.CellFile = None,
    json: options.Json = False,
) -> None:
    """Play a log on the arms themselves, with a soft start and a soft stop; Ctrl-C brakes along the path."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.playback.run import prepare_playback

    specification = PlaybackSpecification(**asked or {})
    what, bar = f"playback of {specification.source}", f"playing at {specification.speed:g}x" * (not json)
    host = Terminal.of(cell, profile, cell_file, what, bar=bar, log_path=log, softly=True)
    result = host.run(prepare_playback(specification, host.description))
    outcome = "played" if result.success else f"failed: {result.failure_reason}"
    error = "" if result.largest_error_mm is None else f" | pads at most {result.largest_error_mm:.1f} mm off"
    played = f"{result.played_s:.2f} of {result.duration_s:.2f} s at {result.speed:g}x"
    report(result, json, f"{outcome} | {played}{error}")
