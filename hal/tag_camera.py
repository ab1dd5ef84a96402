"""The camera that sees tags: `[tracker.camera]` of a cell's file."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.arrays import Array
from hal.configuration import STRICT, NotNegative, Positive, Real


@checked(frozen=True, slots=True, config=STRICT)
class TagCamera:
    """[tracker.camera] of a cell's file: a camera with calibrated intrinsics, and the tags that it looks for.

    source: a device that OpenCV opens (0, /dev/video0), or unix:PATH, where a program of the camera's maker sends grey
    pictures (hal.apriltag.PICTURE, and then the pixels). focal, centre: px, of pictures of this size; distortion: k1,
    k2, p1, p2, k3 of OpenCV. family: of the tags; tag_size: of the outer edge of its black square, m.
    """

    source: str
    size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]
    focal: tuple[Positive, Positive]
    centre: tuple[Real, Real]
    tag_size: Positive
    distortion: tuple[Real, Real, Real, Real, Real] = (0.0, 0.0, 0.0, 0.0, 0.0)
    family: Literal["16h5", "25h9", "36h10", "36h11"] = "36h11"
    rate_hz: NotNegative = 0.0

    @property
    def matrix(self) -> Array:
        """The camera's matrix, (3, 3), px."""
        return np.array([[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0.0, 0.0, 1.0]])
