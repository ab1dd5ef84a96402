"""Robot process and console as services of their own; and how the console finds the rings, in the run folder."""

import argparse
from pathlib import Path

from hal.base.shared import refuse_foreign
from rtstack.live.client import SOCKET_NAME, listens
from rtstack.log.errors import LogError
from rtstack.loop.mailbox import remove_mailbox

MAILBOX = "rtstack-service"
RINGS = "rings"  # file in the run folder: the name of the live rings, while there are any


def process_arguments(prog: str) -> argparse.ArgumentParser:
    """Return the parser of what both processes are started with."""
    parser = argparse.ArgumentParser(prog=prog)
    parser.add_argument("--run", type=Path, required=True, help="folder of the robot process's socket")
    parser.add_argument("--name", required=True, help="name of the shared memory")
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--cell", type=Path, required=True, help="cell description")
    parser.add_argument("--kind", default="direct", help="kind of cell, as the command line spells it")
    parser.add_argument("--alone", action="store_true", help="without a supervisor: a service of its own")
    return parser


def claim(folder: Path, name: str) -> None:
    """Make the run folder ours, without what a killed process left. Raises LogError where one runs there, OSError."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    refuse_foreign(folder)
    path = folder / SOCKET_NAME
    if listens(path):
        raise LogError(f"{folder}: a robot process is running there; end it, or choose another folder with --run")
    path.unlink(missing_ok=True)
    remove_mailbox(f"{name}-mailbox")


def find_rings(folder: Path) -> str:
    """Return the name of the live rings. Raises LogError where no robot process runs."""
    try:
        refuse_foreign(folder)
        return (folder / RINGS).read_text()
    except OSError as error:
        raise LogError(f"{folder}: no robot process runs there ({error.strerror}): start `rtstack robot`") from None
