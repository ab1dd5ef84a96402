"""`rtstack place`: the arms set an object where it is wanted, and again until it stands there."""

from typing import Annotated, Any

import typer

from rtstack.cli.options import CellFile, CellKind, Json, LogOut, ObjectName, Profile, Seed, asks_for
from rtstack.trials.specification import PlacementSpecification

commands = typer.Typer()
Asked = dict[str, Any] | None  # filled by asks_for


@commands.command()
@asks_for(PlacementSpecification)
def place(
    object: ObjectName = "rice_box",
    x_mm: Annotated[float, typer.Option("--x-mm", help="Where it is wanted along x, from its nominal place.")] = 0.0,
    y_mm: Annotated[float, typer.Option("--y-mm", help="Where it is wanted along y.")] = 0.0,
    yaw_deg: Annotated[float, typer.Option("--yaw-deg", help="How far it is to be turned about z.")] = 0.0,
    attempts: Annotated[int, typer.Option(help="How often, at most, until it stands there.", min=1, max=10)] = 3,
    seed: Seed = 0,
    asked: Asked = None,
    log: LogOut = None,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Let both arms take an object from where the tracker sees it, and set it down where it is wanted."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.trials.placement import PreparedPlacement, prepare_placement
    from rtstack.trials.placement import place as place_object
    from rtstack.trials.result import PlacementResult

    specification = PlacementSpecification(**asked or {})
    what, bar = f"placing {specification.title}", "placing" * (not json)
    host = Terminal.of(cell, profile, cell_file, what, bar=bar, log_path=log)
    prepared = prepare_placement(specification, host.description)
    further = [] if log is None else [log.with_name(f"{log.stem}-{n}{log.suffix}") for n in range(2, attempts + 1)]
    logs = [log, *(further or [None] * attempts)]
    done: list[PlacementResult] = []

    def carry(prepared: PreparedPlacement) -> PlacementResult:
        if done:
            typer.echo(f"{done[-1].failure_reason}; again", err=True)
        host.log_path = logs[len(done)]
        done.append(host.run(prepared))
        return done[-1]

    with host.kept_cell(prepared), host.held():
        result = place_object(prepared, attempts, carry)
    outcome = "placed" if result.success else f"failed: {result.failure_reason}"
    off = "not seen" if result.off_mm is None else f"{result.off_mm:.1f} mm and {result.off_deg:.1f} degrees off"
    report(result, json, f"{outcome} | {specification.title} | {off} | at most {result.peak_force_n:.0f} N on a pad")
