"""Layouts of the review under names: which signals, which part of a log. For all operators, beside the logs."""

import json
import threading
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT
from hal.files import write_whole
from rtstack.messages import StrictBool, StrictFloat

FILE_NAME = "layouts.json"  # in the folder of logs
MOST = 64
LayoutName = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[^\p{C}/\\\s]([^\p{C}/\\]*[^\p{C}/\\\s])?$")]
Seconds = Annotated[StrictFloat, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]


class LayoutsError(Exception):
    """The layouts cannot be read or written. The message is one line."""


@checked(frozen=True, slots=True, config=STRICT)
class Layout:
    """signals: their names; from_s, to_s: what is shown, s after the first impact, or after the first sample of a log
    without one; None: all of it. reference, difference: whether these are drawn."""

    signals: Annotated[list[Annotated[str, Field(max_length=128)]], Field(max_length=64)]
    from_s: Seconds | None = None
    to_s: Seconds | None = None
    reference: StrictBool = False
    difference: StrictBool = False


_LAYOUTS = TypeAdapter(dict[LayoutName, Layout])


class Layouts:
    """The layouts of a folder of logs. May be used from any thread."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME
        self._lock = threading.Lock()

    def all(self) -> dict[str, Layout]:
        """Return the layouts by name. Raises LayoutsError."""
        try:
            return _LAYOUTS.validate_json(self._path.read_bytes())
        except FileNotFoundError:
            return {}
        except (OSError, ValidationError) as error:
            raise LayoutsError(f"{self._path}: {str(error).splitlines()[0]}; remove the file to begin anew") from None

    def put(self, name: str, layout: Layout) -> None:
        """Keep a layout, in the place of one of this name. Raises LayoutsError."""
        with self._lock:
            layouts = self.all()
            if name not in layouts and len(layouts) >= MOST:
                raise LayoutsError(f"there are {MOST} layouts; remove one first")
            self._write({**layouts, name: layout})

    def remove(self, name: str) -> bool:
        """Forget a layout; return whether there was one. Raises LayoutsError."""
        with self._lock:
            layouts = self.all()
            known = layouts.pop(name, None) is not None
            if known:
                self._write(layouts)
        return known

    def _write(self, layouts: dict[str, Layout]) -> None:
        try:
            write_whole(self._path, json.dumps({name: asdict(one) for name, one in sorted(layouts.items())}, indent=1))
        except OSError as error:
            raise LayoutsError(f"{self._path}: cannot be written: {error.strerror}") from None
