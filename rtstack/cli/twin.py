"""`rtstack twin`: logs of a cell become a profile of the simulated robot, a friction file, and a report."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.base.configuration import read_toml
from hal.base.files import write_whole
from rtstack.cli.options import CellFile, check_new
from rtstack.cli.replay import forces
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.identification.twin import ArmTwin
    from rtstack.playback.replay import TwinReplay

commands = typer.Typer()
PROFILE, FRICTION, CELL, NUMBERS = "profile.toml", "friction.toml", "cell.toml", "twin.json"


@commands.command()
def twin(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Of one cell: `rtstack excite`, or any.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write; it must not exist.")],
    unloaded: Annotated[
        list[Path], typer.Option(metavar="LOG.mcap", help="Of the same arms without the payload; may be repeated.")
    ] = [],  # noqa: B006
    held_out: Annotated[
        list[Path], typer.Option(metavar="LOG.mcap", help="To judge the twin on, never fitted; may be repeated.")
    ] = [],  # noqa: B006
    cell_file: CellFile = None,
) -> None:
    """Identify both arms from their logs: a profile of the simulated robot, a friction, and what remains unknown."""
    from rtstack.cells import load_description
    from rtstack.identification.twin import friction_file, profile_toml
    from rtstack.identification.twin import twin as identified
    from rtstack.trials.friction import friction_toml
    from sim_robot.plant_parameters import load_plant_parameters

    description, source = load_description(cell_file)
    check_new(out)
    for path in held_out:
        if any(path.samefile(other) for other in (*logs, *unloaded) if path.exists() and other.exists()):
            raise TrialError(f"{path} is to be held out, and to be fitted: leave it out of one of them")
    arms = identified(logs, description, load_plant_parameters().sensors.tau_ext_cutoff_hz, unloaded, held_out)
    with as_file(files("sim_robot") / "parameters" / "profiles" / "ideal.toml") as ideal:
        base, _ = read_toml(ideal)
    out.mkdir()
    write_whole(out / PROFILE, profile_toml(arms, base))
    write_whole(out / FRICTION, friction_toml(friction_file(arms, description.name, len(logs))))
    cell = "\n".join(line for line in source.read_text("utf-8").splitlines() if not line.startswith("joint_friction"))
    write_whole(out / CELL, f'joint_friction = "{FRICTION}"\n{cell}\n')
    for side, arm in arms.items():
        typer.echo("\n".join(_lines(side, arm)))
    whose = ", ".join(map(str, held_out)) or "the end of each log, a fifth"
    typer.echo(f"held out: {whose}")
    replays = list(_replayed(held_out, str(out / PROFILE)))
    used = {"logs": logs, "unloaded": unloaded, "held_out": held_out}
    numbers: dict[str, Any] = {name: list(map(str, paths)) for name, paths in used.items()}
    numbers |= {side: asdict(arm) for side, arm in arms.items()}
    numbers["replays"] = [each.as_dict() for each in replays]
    write_whole(out / NUMBERS, json.dumps(numbers, indent=1) + "\n")
    typer.echo(f"written: {out / PROFILE} (--profile of a simulated cell), {out / CELL} (--cell-file)")


def _replayed(held_out: list[Path], profile: str) -> Iterator["TwinReplay"]:
    """Run the held-out logs again in the twin, those that can be, and print what differs."""
    from rtstack.playback.replay import replay_in_twin

    for path in held_out:
        try:
            made = replay_in_twin(path, profile)
        except TrialError as error:
            typer.echo(f"not run again in the twin: {error}")
            continue
        typer.echo("\n".join(forces(made)))
        yield made


def _lines(side: str, arm: "ArmTwin") -> list[str]:
    from rtstack.identification.twin import LINK, TOUCHING

    names = dict.fromkeys(each.name for each in arm.parameters)
    lines = [f"{side} arm, 95 % intervals; ? is not identified"]
    for name in names:
        cells = [f"{each.value:.4g} ± {each.half_width:.2g}" if each.identified else "?" for each in arm.values(name)]
        lines.append(f"  {name:<18}" + "  ".join(cells))
    for name, values in arm.rms_nm.items():
        lines.append(f"  {'held out, Nm: ' + name:<32}" + "  ".join(f"{value:.3g}" for value in values))
    unknown = [each for each in arm.parameters if not each.identified and each.name not in (*TOUCHING, *LINK)]
    if unknown:
        joints = sorted({each.joint for each in unknown if each.joint})
        what = ", ".join(dict.fromkeys(each.name for each in unknown))
        what += "" if "payload_kg" not in what else " (a payload needs --unloaded)"
        where = f" of joints {', '.join(map(str, joints))}" if joints else ""
        lines.append(
            f"  not identified: {what}{where}; add logs of `rtstack excite OUT.mcap --run N`, each with another N"
        )
    untouched = [each.name for each in arm.parameters if not each.identified and each.name in TOUCHING]
    if untouched:
        grab = "a grab (rtstack trial)" if arm.values(TOUCHING[1]) else "a run in which the pad touches something"
        lines.append(f"  cannot be identified from these logs: {', '.join(untouched)}; add the log of {grab}")
    if not all(each.identified for name in LINK for each in arm.values(name)):
        lines.append(
            "  cannot be identified from these logs: the link; add logs of arms with clocks of their own (10 s)"
        )
    return lines
