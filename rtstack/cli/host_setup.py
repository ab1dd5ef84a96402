"""`rtstack host-setup`: makes a PC one that arms can rely on, after showing what it would do."""

import sys
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import typer

from deploy.host.changes import Change
from deploy.host.journal import Journal
from deploy.host.machine import HostSetupError, Machine
from deploy.host.plan import Interface, Wishes, make_plan
from hal.base.configuration import ConfigurationError
from rtstack.cli.exit_status import fail
from rtstack.cli.interrupt import interruptible

commands = typer.Typer()
_PREFIX = "/opt/rtstack/bin/"  # as the units have it


@commands.command("host-setup")
def host_setup(
    user: Annotated[list[str] | None, typer.Option(help="Who may run the stack at a terminal; repeat it.")] = None,
    nic: Annotated[
        list[str] | None, typer.Option(metavar="NAME=ADDR/PREFIX", help="Interface for the arms; repeat it.")
    ] = None,
    isolate: Annotated[
        int | None, typer.Option(help="CPUs for the loop alone; by default one, where there are four.", min=0)
    ] = None,
    kernel: Annotated[Literal["rt", "generic"], typer.Option(help="rt is PREEMPT_RT.")] = "generic",
    units: Annotated[bool, typer.Option("--units", help="Install the systemd units too.")] = False,
    root: Annotated[Path, typer.Option(metavar="DIR", help="Another machine's files.", readable=False)] = Path("/"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show every change, and make none.")] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Put back exactly what was there.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Undo also what was changed since.")] = False,
) -> None:
    """Set this PC up for the arms: limits, CPU isolation, governor, network; as root."""
    try:
        machine = Machine(root)
        if undo:
            _undo(machine, dry_run, force)
            return
        texts = unit_texts() if units else {}
        interfaces = tuple(Interface.parse(each) for each in nic or [])
        plan = make_plan(machine, Wishes(tuple(user or []), interfaces, isolate, kernel, texts))
        for change in plan.changes:
            typer.echo(f"# {change.why}")
            typer.echo(change.shown(machine), nl=False)
        if dry_run:
            typer.echo(f"{len(plan.changes)} changes, none of them made" if plan.changes else "nothing to change")
        else:
            apply_changes(machine, plan.changes)
        for note in plan.notes:
            typer.echo(f"note: {note}")
    except HostSetupError as error:
        raise ConfigurationError(str(error)) from None


def unit_texts() -> dict[str, str]:
    """Return the units by name, starting the program of this installation."""
    program = f"{Path(sys.executable).parent}/"
    found = sorted(files("deploy.units").iterdir(), key=lambda unit: unit.name)
    return {u.name: u.read_text().replace(_PREFIX, program) for u in found if u.name.endswith((".service", ".timer"))}


def apply_changes(machine: Machine, changes: tuple[Change, ...]) -> None:
    """Apply the changes. Ctrl-C ends it between two of them, with exit status 1. Raises HostSetupError."""
    done = 0
    with interruptible() as interrupt:
        for done, _ in enumerate(Journal(machine).apply(changes), 1):
            if interrupt.stop_requested and done < len(changes):
                fail(f"interrupted after {done} changes: --undo takes them back")
    typer.echo(f"{done} changes made; --undo takes them back" if done else "nothing to change")


def _undo(machine: Machine, dry_run: bool, force: bool) -> None:
    journal = Journal(machine)
    if dry_run:
        for entry in reversed(journal.entries):
            typer.echo(entry.get("path") or " ".join(entry.get("undo", ())), nl=entry["kind"] != "folders")
        return
    count = 0
    with interruptible() as interrupt:
        for line in journal.undo(force):
            count += 1
            if line:
                typer.echo(line)
            if interrupt.stop_requested and journal.entries:
                fail("interrupted: --undo once more goes on")
    typer.echo("as it was before" if count else "nothing to undo: nothing was set up here")
