"""Layouts of the review under names: which signals, which part of a log. For all operators, beside the logs."""

import json
import threading
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.refused import Refused
from hal.base.configuration import STRICT
from rtstack.messages import StrictBool, StrictFloat
from rtstack.references.acceptance import keep_beside, load_beside

FILE_NAME = "layouts.json"  # in the folder of logs
MOST = 64
LAYOUT_NAME: dict[str, Any] = {
    "min_length": 1, "max_length": 60, "pattern": r"^[^\p{C}/\\\s]([^\p{C}/\\]*[^\p{C}/\\\s])?$",
}  # fmt: skip
Seconds = Annotated[StrictFloat, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]


@checked(frozen=True, slots=True, config=STRICT)
class Layout:
    """signals: their names; from_s, to_s: what is shown, s after the first impact, or after the first sample of a log
    without one; None: all of it. reference, difference: whether these are drawn."""

    signals: Annotated[list[Annotated[str, Field(max_length=128)]], Field(max_length=64)]
    from_s: Seconds | None = None
    to_s: Seconds | None = None
    reference: StrictBool = False
    difference: StrictBool = False


_LAYOUTS = dict[Annotated[str, Field(**LAYOUT_NAME)], Layout]
_refused = partial(Refused, 409)


class Layouts:
    """The layouts of a folder of logs. May be used from any thread."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME
        self._lock = threading.Lock()

    def all(self) -> dict[str, Layout]:
        """Return the layouts by name. Raises Refused."""
        return load_beside(self._path, _LAYOUTS, _refused)

    def put(self, name: str, layout: Layout) -> None:
        """Keep a layout, in the place of one of this name. Raises Refused."""
        with self._lock:
            layouts = self.all()
            if name not in layouts and len(layouts) >= MOST:
                raise _refused(f"there are {MOST} layouts; remove one first")
            self._write({**layouts, name: layout})

    def remove(self, name: str) -> None:
        """Forget a layout. Raises Refused."""
        with self._lock:
            layouts = self.all()
            if layouts.pop(name, None) is None:
                raise Refused(404, "there is no layout of this name")
            self._write(layouts)

    def _write(self, layouts: dict[str, Layout]) -> None:
        said = {name: asdict(one) for name, one in sorted(layouts.items())}
        keep_beside(self._path, json.dumps(said, indent=1), _refused)
