"""Control that outlasts a command: who let FCI in keeps control, and gives it back when FCI is ended.

What a box gave is kept in a file that its user alone can read, beside the box's certificate.
"""

import json
from pathlib import Path

from hal.desk.client import Control, Desk
from hal.desk.trust import Trust
from hal.files import write_whole


def control_file(trust: Trust, address: str) -> Path:
    """Return where control of the box at HOST[:PORT] is kept."""
    return trust.folder / f"{address}.control"


def adopt(desk: Desk, trust: Trust, address: str) -> bool:
    """Go on with control that was kept, where it still counts. Raises DeskError, NotTrusted."""
    try:
        kept = json.loads(control_file(trust, address).read_text())
        desk.control = Control(str(kept["token"]), int(kept["number"]))
    except (OSError, ValueError, KeyError, TypeError):
        return False
    if not desk.has_control():
        desk.control = None
    return desk.control is not None


def keep(desk: Desk, trust: Trust, address: str) -> None:
    """Keep control for a later command. Raises OSError."""
    if desk.control is not None:
        content = json.dumps({"token": desk.control.token, "number": desk.control.number})
        write_whole(control_file(trust, address), content, mode=0o600)


def give_back(desk: Desk, trust: Trust, address: str) -> None:
    """Give control back, and keep it no more. Raises DeskError."""
    desk.release_control()
    control_file(trust, address).unlink(missing_ok=True)
