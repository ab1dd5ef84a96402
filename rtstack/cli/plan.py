"""`rtstack plan`: a reference without a demonstration. Everything is checked before anything is written."""

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtstack.cli.options import CellFile, Json, ObjectName, asks_for
from rtstack.references.motion import Motion

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription
    from rtstack.planning import PlannedMotion

commands = typer.Typer()
_GRAB_ONLY = ("rise", "squeeze", "lift", "lift_s", "momentum_s", "carry")
_PUSH_ONLY = ("travel",)


def _value(metavar: str, help: str, kind: Any = float) -> Any:
    return Annotated[kind | None, typer.Option(metavar=metavar, help=help)]


_OPTIONS = {
    "speed": _value("M/S", "Of the pads along y when they hit, 0.05 to 0.8; less if need be: 0.35, of a push 0.5."),
    "rise": _value("M/S", "Of a grab's pads upwards when they hit, 0.05 to 0.8: 0.25."),
    "height": _value("M", "Of the pads over the object's centre: 0.02, of a push 0."),
    "posture": _value("RAD", "Joint 1 at the impact, from home, -1.5 to 1.5: 0."),
    "squeeze": _value("N", "Force of each of a grab's pads, up to 120: 40."),
    "lift": _value("M", "How high a grab lifts, up to 0.5: 0.25."),
    "lift_s": _value("S", "How long the lift takes, up to 10: 1.2."),
    "momentum_s": _value("S", "How long a grab is lifted by momentum alone after the impact, up to 0.2: 0.1."),
    "carry": _value("M", "How far a grab carries along x, -0.5 to 0.5: 0.05."),
    "travel": _value("M", "How far a push goes, up to 0.5: 0.25."),
    "inertia": _value("WHICH", "Of the motors in the map, B, none or B_theta: B_theta.", str),
    "map": _value(
        "WHICH", "What gives the velocity after the impact, single_step as in the paper, or converged: converged.", str
    ),
    "post_impact_scale": _value("FACTOR", "A wrong post-impact velocity on purpose, 0.5 to 1.5: 1."),
}


@commands.command()
@asks_for(_OPTIONS)
def plan(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The reference to write.")],
    motion: Annotated[
        Motion, typer.Option(help="Both arms lift the object, or one pushes it, of two the left one.")
    ] = Motion.GRAB,
    object_name: ObjectName = "rice_box",
    asked: dict[str, Any] | None = None,  # filled by asks_for
    watch: Annotated[
        int | None,
        typer.Option(metavar="RUNS", help="Make its monitor too, from so many simulated runs of it.", min=9, max=100),
    ] = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Plan a reference without a demonstration: paths before and after the impact, joined by the impact map.

    The default of an option follows its colon.
    """
    from rtstack.cells import load_description
    from rtstack.log.writer import check_log_path
    from rtstack.planning import PlanError
    from rtstack.planning.file import write_plan

    description, source = load_description(cell_file)
    given = asked or {}
    check_log_path(output)
    for key in _PUSH_ONLY if motion is Motion.GRAB else _GRAB_ONLY:
        if key in given:
            raise PlanError(f"--{key.replace('_', '-')} does not belong to a {motion}: leave it out")
    planned, slower = _planned(description, motion, object_name, given)
    tuning, found = None, None
    if watch is not None:
        from rtstack.cli.plan_monitor import plan_monitor

        tuning, found = plan_monitor(planned, output.stem, description, watch, not json, source)
    write_plan(output, planned, description, source, tuning)
    if json:
        watched = None if found is None else {"runs": watch, "held_out": found.runs, "margin": found.smallest_margin}
        typer.echo(json_module.dumps({**planned.as_dict(), "monitor": watched, "file": str(output)}))
        return
    typer.echo("\n".join([*_lines(planned, output), *slower]))
    if found is not None:
        typer.echo(f"  monitor: from {watch} simulated runs, {found.runs} of them held out: no false alarm, smallest "
                   f"margin {found.smallest_margin:.2f}")  # fmt: skip
    file = "" if cell_file is None else f" --cell-file {cell_file}"
    typer.echo(f"  follow it: rtstack trial --reference {output} --object {object_name}{file}")


def _planned(
    description: "CellDescription", motion: Motion, object_name: str, given: dict[str, Any]
) -> "tuple[PlannedMotion, list[str]]":
    """Return the motion, with the fastest speed that does where the default is too fast, and a line about that."""
    from rtstack.planning import GrabPlan, PushPlan, TooFast, checked_plan, plan_grab, plan_push

    def planned(**values: Any) -> "PlannedMotion":
        if motion is Motion.GRAB:
            return plan_grab(description, object_name, checked_plan(GrabPlan, **values))
        return plan_push(description, object_name, checked_plan(PushPlan, **values))

    try:
        return planned(**given), []
    except TooFast as error:
        if "speed" in given or error.fastest is None:
            raise
        return planned(**given, speed=error.fastest), [f"  slower than by default: {error}"]


def _lines(planned: "PlannedMotion", output: Path) -> list[str]:
    recording, result = planned.recording, planned.map
    lines = [f"planned {output}: {recording.motion} of {recording.object}, impact at {recording.impact_s:.3f} s"]
    for arm, side in enumerate(planned.sides):
        if side not in result.problem.names:
            continue
        before, after, single = (
            _numbers(twist[:3])
            for twist in (result.twist_before(side), result.twist(side), result.twist(side, result.single_step))
        )
        lines.append(f"  {side:<6} {before} m/s, then {after} converged, {single} single step; planned "
                     f"{_numbers(planned.velocities[arm])}")  # fmt: skip
    converged = result.converged
    for k, (contact, rows) in enumerate(zip(result.problem.contacts, result.problem.points, strict=True)):
        total, pressing = converged.impulses[rows, 2].sum(), converged.pressing_ns[k]
        held = f"; to be pressed with {pressing:.2g} Ns" if pressing > 0.0 else ""
        lines.append(f"  {' on '.join(contact.between)}: {total:.3f} Ns{held}")
    lines.append(f"  map: {converged.status}, {converged.detail}")
    return lines


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.3f}" for value in values.round(3) + 0.0)  # no -0.000
