"""`rtstack robot` and `rtstack console`: the parts of `rtstack up`, each for a service manager to watch over."""

import os
import sys
from pathlib import Path

from rtstack.cells import load_description
from rtstack.cli.stack import make_log_folder
from rtstack.live.source import described_as
from rtstack.live.stack import StackError, listen
from rtstack.live.standalone import MAILBOX, find_rings
from rtstack.trials.errors import TrialError


def robot(run: Path, logs: Path, cell_file: Path | None, kind: str) -> None:
    """Become the robot process. Raises TrialError, ConfigurationError."""
    shared = _shared(run, logs, cell_file, kind)
    make_log_folder(logs)
    _become("rtstack.live.robot", shared)


def console(run: Path, port: int, logs: Path, cell_file: Path | None, kind: str) -> None:
    """Become the console of the robot process in a run folder. Raises TrialError, ConfigurationError, LogError."""
    shared = _shared(run, logs, cell_file, kind)
    rings = find_rings(run)
    try:
        listener = listen(port)
    except StackError as error:
        raise TrialError(str(error)) from None
    make_log_folder(logs)
    listener.set_inheritable(True)
    _become("console", [*shared, "--rings", rings, "--listener", str(listener.fileno())])


def _shared(run: Path, logs: Path, cell_file: Path | None, kind: str) -> list[str]:
    source = load_description(cell_file)[1]
    described_as(source, kind)
    return ["--alone", f"--run={run}", f"--name={MAILBOX}", f"--logs={logs}", f"--cell={source}", f"--kind={kind}"]


def _become(module: str, arguments: list[str]) -> None:
    """Put a module in the place of this process: the manager watches over the id that it has started."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])
