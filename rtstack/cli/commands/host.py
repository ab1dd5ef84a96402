"""Commands about this machine."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import CellFile, Json, LeftArm, LogsWritten, RightArm

commands = typer.Typer()


@commands.command()
def check(
    left: LeftArm = None,
    right: RightArm = None,
    cell_file: CellFile = None,
    logs: LogsWritten = Path("logs"),
    json: Json = False,
) -> None:
    """Say what this machine lacks, and what that costs; with both addresses hold the arms and judge the link."""
    from rtstack.cli.check import check as run

    run(left, right, cell_file, logs, json)


@commands.command("host-setup")
def host_setup(
    user: Annotated[list[str] | None, typer.Option(help="Who may run the stack at a terminal; repeat it.")] = None,
    nic: Annotated[
        list[str] | None, typer.Option(metavar="NAME=ADDR/PREFIX", help="Interface for the arms; repeat it.")
    ] = None,
    isolate: Annotated[
        int | None, typer.Option(help="CPUs for the loop alone; by default one, where there are four.", min=0)
    ] = None,
    kernel: Annotated[str, typer.Option(help="rt (PREEMPT_RT) or generic.")] = "generic",
    units: Annotated[bool, typer.Option("--units", help="Install the systemd units too.")] = False,
    root: Annotated[Path, typer.Option(metavar="DIR", help="Another machine's files.", readable=False)] = Path("/"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show every change, and make none.")] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Put back exactly what was there.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Undo also what was changed since.")] = False,
) -> None:
    """Set this PC up for two arms: limits, CPU isolation, governor, network; as root."""
    from rtstack.cli.host_setup import host_setup as run

    run(user or [], nic or [], isolate, kernel, units, root, dry_run, undo, force)
