"""`rtstack up`: the whole stack on this machine."""

from pathlib import Path

import typer

from rtstack.cli.cells import fci_addresses, load_description
from rtstack.live.stack import StackSettings, run_stack
from rtstack.trials.errors import TrialError

SOURCE = "rtstack.cli.cells:live_source"


def up(port: int, logs: Path, cell_file: Path | None, left: str | None = None, right: str | None = None) -> None:
    """Start the stack and stay until it ends; with both addresses on these arms. Raises TrialError."""
    kind = kind_of(left, right)
    _, source = load_description(cell_file)
    make_log_folder(logs)
    raise typer.Exit(run_stack(StackSettings(port=port, logs=logs, source=SOURCE, cell=source, kind=kind)))


def kind_of(left: str | None, right: str | None) -> str:
    """Return the kind of cell that both addresses make, or none of them. Raises TrialError."""
    if (left is None) != (right is None):
        raise TrialError("two arms have two addresses: give --left and --right, or neither for the simulated cell")
    if left is None:
        return "direct"
    fci_addresses(kind := f"fci:{left},{right}")
    return kind


def make_log_folder(logs: Path) -> None:
    """Make the folder of logs, if it is not there. Raises TrialError."""
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialError(f"cannot write logs to {logs}: {error.strerror}") from None
