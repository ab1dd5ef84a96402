"""`rtstack up`: the whole stack on this machine."""

from pathlib import Path

import typer

from rtstack.cells import load_description, with_profile
from rtstack.cells.fci import fci_addresses
from rtstack.live.source import described_as
from rtstack.live.stack import StackSettings, run_stack
from rtstack.trials.errors import TrialError


def up(port: int, logs: Path, cell_file: Path | None, kind: str) -> None:
    """Start the stack on a kind of cell and stay until it ends. Raises TrialError."""
    source = load_description(cell_file)[1]
    described_as(source, kind)
    make_log_folder(logs)
    raise typer.Exit(run_stack(StackSettings(port=port, logs=logs, cell=source, kind=kind)))


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
    fci_addresses(kind := f"fci:{left},{right}")
    return with_profile(kind, profile)


def make_log_folder(logs: Path) -> None:
    """Make the folder of logs, if it is not there. Raises TrialError."""
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialError(f"cannot write logs to {logs}: {error.strerror}") from None
