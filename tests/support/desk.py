"""Desk of a served simulated robot, as a user of this machine reaches it."""

from collections.abc import Iterable
from pathlib import Path

from hal.desk import Desk, SignIn, Trust
from rtstack.cells import default_cell_file
from sim_robot.desk.process import PORT
from sim_robot.desk.server import PASSWORD, USER

SIGN_IN = SignIn(USER, PASSWORD)


def desk_address(address: str) -> str:
    """Return where Desk of the simulated box is whose arm is at this address."""
    return f"{address}:{PORT}"


def desk_cell_file(path: Path, desks: Iterable[str], serials: tuple[str, str] | None = None) -> Path:
    """Write the grabbing cell's file with Desk of both boxes, and their serial numbers; return it."""
    text = default_cell_file().read_text().replace("127.0.0.1:1341", "127.0.0.1:0")
    for k, (side, desk) in enumerate(zip(("left", "right"), desks, strict=True)):
        serial = f'serial = "{serials[k]}"\n' if serials else ""
        text = text.replace(f"[{side}]\n", f'[{side}]\ndesk = "{desk}"\n{serial}')
    path.write_text(text)
    return path


def desk_of(address: str, trust: Trust, sign_in: SignIn | None = SIGN_IN) -> Desk:
    """Return a client of that Desk, which trust knows from now on."""
    trust.remember(desk_address(address))
    return Desk(desk_address(address), trust, sign_in)
