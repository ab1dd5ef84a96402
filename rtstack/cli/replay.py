"""`rtstack replay`: logs through the present controller, or their commands through a twin; a table of what differs."""

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtstack.cli.exit_status import FAILED
from rtstack.cli.options import Json

if TYPE_CHECKING:
    from rtstack.playback.replay import Replay, TwinReplay

commands = typer.Typer()
SHOWN = 12  # fields in the table
SAME_FORCE = 0.1  # a twin's contact force is as the log's within this share of it


@commands.command()
def replay(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Trials, demonstrations, teleoperations.")],
    json: Json = False,
    twin: Annotated[
        str | None,
        typer.Option(
            metavar="PROFILE",
            help="Run the log's commands in this profile's plant: does its contact force come out within 10 %?",
        ),
    ] = None,
) -> None:
    """Give a log's states to the present controller: does it make the same of them, bit by bit? No arm moves."""
    from rtstack.playback.replay import replay as replayed
    from rtstack.playback.replay import replay_in_twin

    if twin is not None:
        made = [replay_in_twin(path, twin) for path in logs]
        told = [(each.as_dict(), forces(each)) for each in made]
        same = not any(abs(arm.off) > SAME_FORCE for each in made for arm in each.arms if arm.off is not None)
    else:
        found = [replayed(path) for path in logs]
        told, same = [(each.as_dict(), _lines(each)) for each in found], all(each.same for each in found)
    for document, lines in told:
        typer.echo(json_module.dumps(document) if json else "\n".join(lines))
    if not same:
        raise typer.Exit(FAILED)


def _lines(found: "Replay") -> list[str]:
    head = f"{found.log}: {found.kind}, {found.ticks} ticks: "
    if found.same:
        return [head + "every bit of what controller and judge make of them is the same"]
    logged, now = found.commits
    if found.replayed_ticks != found.ticks:
        head += f"the replay ended after {found.replayed_ticks}; "
    if not found.differences:
        return [head + "no field differs until then"]
    first = found.differences[0]
    lines = [
        f"{head}{first.side} {first.field} is the first to differ, in tick {first.first_tick}: {first.logged!r} in the "
        f"log, {first.replayed!r} now (commit {logged[:12]} then, {now[:12]} now)",
        f"{'arm':<6}{'field':<24}{'ticks':>7}{'first':>7}{'in the log':>14}{'now':>14}{'largest diff.':>15}",
    ]
    lines += [
        f"{d.side:<6}{d.field:<24}{d.ticks:>7}{d.first_tick:>7}{d.logged:>14.6g}{d.replayed:>14.6g}{d.largest:>15.3g}"
        for d in found.differences[:SHOWN]
    ]
    more = len(found.differences) - SHOWN
    return lines + [f"and {more} fields more"] * (more > 0)


def forces(made: "TwinReplay") -> list[str]:
    """Return the table of a replay in a twin: forces, and how far hands, torques and velocities are apart."""
    lines = [f"{made.log}: {made.kind}, {made.ticks} ticks; in {made.twin} {made.replayed_ticks}"]
    lines.append(f"{'arm':<6}{'contact':>10}{'mean force':>14}{'twin':>9}{'off':>8}{'peak':>9}{'twin':>9}{'path':>9}"
                 f"{'torque':>10}{'velocity':>12}")  # fmt: skip
    for arm in made.arms:
        mean, peak = ([f"{value:.1f} N" for value in pair] for pair in (arm.mean_n, arm.peak_n))
        off = "-" if arm.off is None else f"{100.0 * arm.off:+.1f} %"
        lines.append(f"{arm.side:<6}{1e-3 * arm.ticks:>8.1f} s{mean[0]:>14}{mean[1]:>9}{off:>8}{peak[0]:>9}{peak[1]:>9}"
                     f"{arm.path_mm:>6.1f} mm{max(arm.torque_nm):>7.2f} Nm{max(arm.velocity):>6.3f} rad/s")  # fmt: skip
    return lines
