"""`rtstack host-setup`: makes a PC one that two arms can rely on, after showing what it would do."""

import sys
from importlib.resources import files
from pathlib import Path

import typer

from deploy.host import Change, Command, HostSetupError, Interface, Journal, Machine, Wishes, make_plan
from hal.configuration import ConfigurationError
from rtstack.cli.interrupt import interruptible

FAILED = 1
_PREFIX = "/opt/rtstack/bin/"  # as the units have it
_UNITS = (".service", ".timer")


def host_setup(
    users: list[str], nics: list[str], isolate: int | None, kernel: str, units: bool, root: Path, dry_run: bool,
    undo: bool, force: bool,
) -> None:  # fmt: skip
    """Show, apply or undo. Raises ConfigurationError; exit status 1 where it was interrupted."""
    try:
        machine = Machine(root)
        if undo:
            _undo(machine, dry_run, force)
            return
        texts = unit_texts() if units else {}
        interfaces = tuple(Interface.parse(nic) for nic in nics)
        if kernel not in ("rt", "generic"):
            raise HostSetupError(f"--kernel {kernel}: choose rt or generic")
        plan = make_plan(machine, Wishes(tuple(users), interfaces, isolate, kernel, texts))
        for change in plan.changes:
            typer.echo(f"# {change.why}")
            typer.echo(shown(machine, change), nl=False)
        if dry_run:
            typer.echo(f"{len(plan.changes)} changes, none of them made" if plan.changes else "nothing to change")
        else:
            apply_changes(machine, plan.changes)
        for note in plan.notes:
            typer.echo(f"note: {note}")
    except HostSetupError as error:
        raise ConfigurationError(str(error)) from None


def unit_texts(prefix: str = "") -> dict[str, str]:
    """Return the units by name, starting the program of this installation (prefix: of another one)."""
    program = prefix or f"{Path(sys.executable).parent}/"
    found = sorted(files("deploy.units").iterdir(), key=lambda unit: unit.name)
    return {u.name: u.read_text().replace(_PREFIX, program) for u in found if u.name.endswith(_UNITS)}


def shown(machine: Machine, change: Change) -> str:
    """Return a change as a diff, or a command line."""
    if isinstance(change, Command):
        return change.shown()
    try:
        before = machine.at(change.path).read_bytes()
    except FileNotFoundError:
        before = None
    except OSError as error:
        raise HostSetupError(f"{change.path}: {error.strerror}; run it as root") from None
    return change.shown(before)


def apply_changes(machine: Machine, changes: tuple[Change, ...]) -> None:
    """Apply the changes. Ctrl-C ends it between two of them, with exit status 1. Raises HostSetupError."""
    done = 0
    with interruptible() as interrupt:  # between two changes
        for _ in Journal(machine).apply(changes):
            done += 1
            if interrupt.stop_requested and done < len(changes):
                typer.echo(f"rtstack: interrupted after {done} changes: --undo takes them back", err=True)
                raise typer.Exit(FAILED)
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
                typer.echo("rtstack: interrupted: --undo once more goes on", err=True)
                raise typer.Exit(FAILED)
    typer.echo("as it was before" if count else "nothing to undo: nothing was set up here")
