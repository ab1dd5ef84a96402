"""What a camera is, for who writes one: it gives pictures with the log's time. Cameras are entry points."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from hal.extensions import ExtensionPoint
from rtstack.log.ring import Rings
from rtstack.model.camera_description import CameraDescription

STAMP_BITS, STAMP_PX, STAMP_NS = 48, 8, 100_000


@dataclass(frozen=True, slots=True)
class CameraRequest:
    """What a camera is opened with. rings: what the loop says; cell_file: the cell's; object_name: what it holds."""

    name: str
    camera: CameraDescription
    rings: Rings
    cell_file: Path
    object_name: str


class Camera(Protocol):
    """An open camera, in a process of its own."""

    def read(self) -> tuple[int, NDArray[np.uint8]] | None:
        """Return the next picture (rows, columns, 3), RGB, and its time in the log's clock, ns; None where there is
        none yet, after 0.1 s at most. Raises OSError with the reason where there will be none any more."""

    def close(self) -> None:
        """Release it. Never raises."""


CAMERAS = ExtensionPoint[Callable[[CameraRequest], Camera]]("rtstack.cameras", "camera", cast(Any, Callable))


def draw_time(picture: NDArray[np.uint8], t_ns: int) -> None:
    """Draw a time into the first STAMP_PX rows of a picture, as a square for each bit, the highest first; a square is
    white for one. Times are in steps of 0.1 ms."""
    for bit in range(STAMP_BITS):
        one = t_ns // STAMP_NS >> (STAMP_BITS - 1 - bit) & 1
        picture[:STAMP_PX, STAMP_PX * bit : STAMP_PX * (bit + 1)] = 255 * one
