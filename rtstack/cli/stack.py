"""`rtstack up`: the whole stack on this machine."""

from pathlib import Path

import typer

from rtstack.cli.cells import load_description
from rtstack.live.stack import StackSettings, run_stack
from rtstack.trials.errors import TrialError

SOURCE = "rtstack.cli.cells:live_source"


def up(port: int, logs: Path, cell_file: Path | None) -> None:
    """Start the stack and stay until it ends."""
    _, source = load_description(cell_file)
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialError(f"cannot write logs to {logs}: {error.strerror}") from None
    raise typer.Exit(run_stack(StackSettings(port=port, logs=logs, source=SOURCE, cell=source)))
