"""`rtstack up`: the whole stack; `rtstack robot` and `rtstack console`: its parts, each for a service manager."""

import os
import sys
from ipaddress import ip_address
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Annotated

import typer

from hal.base.extras import require
from rtstack.cli.options import CellFile, LeftArm, LogsWritten, Profile, RightArm
from rtstack.live.stack import LOOPBACK, StackError, StackSettings, listen, run_stack
from rtstack.live.standalone import MAILBOX, find_rings
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription

commands = typer.Typer()
Port = Annotated[int, typer.Option(help="Port of the console, on the loopback address.", min=0, max=65535)]
LiveCellKind = Annotated[
    str | None,
    typer.Option(metavar="NAME[:ARGUMENT]", help="Kind of cell instead of --left and --right, also of a package's."),
]
RunFolder = Annotated[Path, typer.Option("--run", metavar="DIR", help="Where robot process and console meet.")]
# the first name of --cell-file where the cell is no kind: other people's scripts and unit files have it
OldCellFile = Annotated[Path | None, typer.Option("--cell", hidden=True)]


@commands.command()
def up(
    port: Port = 8080,
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
    https: Annotated[bool, typer.Option("--https", help="Speak HTTPS, with an authority of your own.")] = False,
    host: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Listen there instead of on the loopback address; needs --https."),
    ] = None,
) -> None:
    """Start the whole stack, with the arms at --left and --right or the simulated cell; Ctrl-C ends all of it."""
    kind = _chosen_kind(cell_kind, left, right, profile)
    require("console")
    from rtstack.live.first_use import FirstUse

    address = _address(host, https)
    source, description = _cell_file(cell_file or cell, kind)
    _make_log_folder(logs)
    _listener(port, address).close()  # a port that cannot be used is said before what takes long
    first_use = FirstUse(len(description.sides))
    if description.simulated:
        first_use.begin()
    else:
        first_use.wait()  # nothing else computes while real arms are held
    raise typer.Exit(run_stack(StackSettings(port, logs, source, kind, address, https)))


@commands.command()
def robot(
    run_folder: RunFolder = Path("/run/rtstack"),
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
) -> None:
    """Run the robot process alone, as a service does: cell, loop and logs; disarmed, until an operator arms."""
    from rtstack.live.first_use import FirstUse

    shared, arms = _shared(run_folder, logs, cell_file or cell, _chosen_kind(cell_kind, left, right, profile))
    _make_log_folder(logs)
    FirstUse(arms).wait()
    _become("rtstack.live.robot", shared)


@commands.command()
def console(
    run_folder: RunFolder = Path("/run/rtstack"),
    port: Port = 8080,
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
) -> None:
    """Run the console alone, beside `rtstack robot`, with the same options."""
    kind = _chosen_kind(cell_kind, left, right, profile)
    require("console")
    shared, _ = _shared(run_folder, logs, cell_file or cell, kind)
    find_rings(run_folder)
    listener = _listener(port)
    _make_log_folder(logs)
    listener.set_inheritable(True)
    _become("console", [*shared, "--listener", str(listener.fileno())])


def _address(host: str | None, https: bool) -> str:
    """Return where the console listens; with https, say who vouches for it. Raises TrialError, ConfigurationError."""
    try:
        address = ip_address(host or LOOPBACK)
    except ValueError:
        raise TrialError(f"--host {host}: expected an IP address of this machine") from None
    if address.version != 4 or address.is_unspecified:
        raise TrialError(f"--host {host}: expected one IPv4 address of this machine, no other kind and not all of them")
    if not https:
        if not address.is_loopback:
            raise TrialError(f"--host {host}: other machines are let in over HTTPS only: give --https too")
        return str(address)
    from rtstack.access.authority import Authority

    authority = Authority.of_user()
    authority.check(str(address))
    print(
        f"rtstack: {authority.certificate} vouches for this console: a browser imports it once.\n"
        f"rtstack: its fingerprint is {authority.fingerprint}", file=sys.stderr, flush=True,
    )  # fmt: skip
    return str(address)


def _chosen_kind(kind: str | None, left: str | None, right: str | None, profile: str | None) -> str:
    """Return the kind of cell that is named, that the addresses make, or the simulated one. Raises TrialError."""
    from rtstack.cells import with_profile

    if kind is not None and (left is not None or right is not None):
        raise TrialError("--cell-kind says which arms there are, and so do --left and --right: give one of them")
    if kind is not None:
        return with_profile(kind, profile)
    if left is None and right is None:
        return with_profile("direct", profile)
    from rtstack.cells.fci import fci_addresses  # and with it pylibfranka, which not every Python has

    fci_addresses(kind := f"fci:{left or ''}" + f",{right}" * (right is not None))
    return with_profile(kind, profile)


def _make_log_folder(logs: Path) -> None:
    """Make the folder of logs, if it is not there. Raises TrialError."""
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialError(f"cannot write logs to {logs}: {error.strerror}") from None


def _cell_file(cell_file: Path | None, kind: str) -> "tuple[Path, CellDescription]":
    """Return the file of a cell that can be of this kind, and what it says. Raises TrialError, ConfigurationError."""
    from rtstack.cells import load_description
    from rtstack.live.source import described_as

    source = load_description(cell_file)[1]
    return source, described_as(source, kind)


def _shared(run: Path, logs: Path, cell_file: Path | None, kind: str) -> tuple[list[str], int]:
    source, description = _cell_file(cell_file, kind)
    return [
        "--alone", f"--run={run}", f"--name={MAILBOX}", f"--logs={logs}", f"--cell={source}", f"--kind={kind}",
    ], len(description.sides)  # fmt: skip


def _listener(port: int, host: str = LOOPBACK) -> socket:
    """Return the console's listening socket. Raises TrialError."""
    try:
        return listen(port, host)
    except StackError as error:
        raise TrialError(str(error)) from None


def _become(module: str, arguments: list[str]) -> None:
    """Put a module in the place of this process: the manager watches over the id that it has started."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])
