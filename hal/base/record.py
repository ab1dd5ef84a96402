"""The fields of a record of samples: name, text, unit, frame, names of the values. numpy's dtype is made from them."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

JOINTS = tuple(str(number) for number in range(1, 8))
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
POSITION = ("x", "y", "z")
QUATERNION = ("w", "x", "y", "z")
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
MATRIX = tuple(name for row in "123" for name in (f"r{row}1", f"r{row}2", f"r{row}3", "xyz"[int(row) - 1]))


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a record. The first field of every record is t_ns, the robot's time, which is not listed.

    text: a sentence for the log's schema; {unit} in it stands for the unit. frame: of what has one.
    axes: the names of an array's values; without a shape there are as many values. shape: of an array of which axes
    names the first values only, row-major. kind: numpy's, one of f8, i8 and S24 (ASCII, 24 bytes).
    enum: what a number stands for. bits: the names of a mask's bits, from the lowest one.
    column_major: a matrix that is column-major in the log, as in libfranka. host_clock: measured by the host, and
    not the same in a second run. plotted: whether it is a curve. plain: what it is in words, beside libfranka's name.
    reference: the field of the same group that this one is to follow.
    """

    name: str
    text: str
    unit: str = ""
    axes: tuple[str, ...] = ()
    frame: str = ""
    kind: str = "f8"
    shape: tuple[int, ...] = ()
    enum: type[IntEnum] | None = None
    bits: tuple[str, ...] = ()
    column_major: bool = False
    host_clock: bool = False
    plotted: bool = True
    plain: str = ""
    reference: str = ""

    @property
    def dtype(self) -> np.dtype[Any]:
        whole = self.enum is not None or bool(self.bits)
        return np.dtype(("i8" if whole else self.kind, self.shape or ((len(self.axes),) if self.axes else ())))

    @property
    def comment(self) -> str:
        """The text with its unit."""
        return self.text.replace("{unit}", self.unit)


def record_of(fields: Sequence[Field]) -> np.dtype[Any]:
    """Return the dtype of a record: t_ns (int64, ns of the robot's time), then the fields in their order."""
    return np.dtype([("t_ns", "i8"), *((field.name, field.dtype) for field in fields)])
