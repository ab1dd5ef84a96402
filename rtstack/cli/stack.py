"""`rtstack up`: the whole stack; `rtstack robot` and `rtstack console`: its parts, each for a service manager."""

import os
import sys
from ipaddress import ip_address
from pathlib import Path

import typer

from hal.extras import require
from rtstack.cells import load_description, with_profile
from rtstack.live.source import described_as
from rtstack.live.stack import LOOPBACK, StackError, StackSettings, listen, run_stack
from rtstack.live.standalone import MAILBOX, find_rings
from rtstack.trials.errors import TrialError


def up(port: int, logs: Path, cell_file: Path | None, kind: str, host: str | None = None, https: bool = False) -> None:
    """Start the stack on a kind of cell and stay until it ends. Raises TrialError, ConfigurationError."""
    require("console")
    host = _host(host, https)
    source = load_description(cell_file)[1]
    described_as(source, kind)
    make_log_folder(logs)
    raise typer.Exit(run_stack(StackSettings(port, logs, source, kind, host, https)))


def _host(host: str | None, https: bool) -> str:
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
    from console.authority import Authority

    authority = Authority.of_user()
    authority.check(str(address))
    print(
        f"rtstack: {authority.certificate} vouches for this console: a browser imports it once.\n"
        f"rtstack: its fingerprint is {authority.fingerprint}", file=sys.stderr, flush=True,
    )  # fmt: skip
    return str(address)


def chosen_kind(kind: str | None, left: str | None, right: str | None, profile: str | None = None) -> str:
    """Return the kind of cell that is named, that both addresses make, or the simulated one, with the profile.

    Raises TrialError.
    """
    if kind is not None and (left is not None or right is not None):
        raise TrialError("--cell-kind says which arms there are, and so do --left and --right: give one of them")
    if kind is not None:
        return with_profile(kind, profile)
    if (left is None) != (right is None):
        raise TrialError("two arms have two addresses: give --left and --right, or neither for the simulated cell")
    if left is None:
        return with_profile("direct", profile)
    from rtstack.cells.fci import fci_addresses  # and with it pylibfranka, which not every Python has

    fci_addresses(kind := f"fci:{left},{right}")
    return with_profile(kind, profile)


def make_log_folder(logs: Path) -> None:
    """Make the folder of logs, if it is not there. Raises TrialError."""
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialError(f"cannot write logs to {logs}: {error.strerror}") from None


def robot(run: Path, logs: Path, cell_file: Path | None, kind: str) -> None:
    """Become the robot process. Raises TrialError, ConfigurationError."""
    shared = _shared(run, logs, cell_file, kind)
    make_log_folder(logs)
    _become("rtstack.live.robot", shared)


def console(run: Path, port: int, logs: Path, cell_file: Path | None, kind: str) -> None:
    """Become the console of the robot process in a run folder. Raises TrialError, ConfigurationError, LogError."""
    require("console")
    shared = _shared(run, logs, cell_file, kind)
    find_rings(run)
    try:
        listener = listen(port)
    except StackError as error:
        raise TrialError(str(error)) from None
    make_log_folder(logs)
    listener.set_inheritable(True)
    _become("console", [*shared, "--listener", str(listener.fileno())])


def _shared(run: Path, logs: Path, cell_file: Path | None, kind: str) -> list[str]:
    source = load_description(cell_file)[1]
    described_as(source, kind)
    return ["--alone", f"--run={run}", f"--name={MAILBOX}", f"--logs={logs}", f"--cell={source}", f"--kind={kind}"]


def _become(module: str, arguments: list[str]) -> None:
    """Put a module in the place of this process: the manager watches over the id that it has started."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])
