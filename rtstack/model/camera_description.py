"""A camera of a cell, `[cameras.NAME]`."""

import math
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, Real
from hal.pad import Quaternion, Vector


@checked(frozen=True, slots=True, config=STRICT)
class CameraDescription:
    """A camera, `[cameras.NAME]`.

    kind: an entry point of rtstack.cameras; address: a device or file. position, m, and orientation_wxyz, in the world:
    it looks along its z, its x is to the picture's right. fov_y_deg: of the picture's height; intrinsics (9,): K,
    row-major, px, in its place where it was measured, with distortion (k1, k2, p1, p2, k3). stamped: the time is drawn
    into each picture; format: of the log; quality: of the JPEG.
    """

    kind: str
    position: Vector
    orientation_wxyz: Quaternion
    address: str = ""
    width: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 640
    height: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 480
    rate_hz: Annotated[float, Field(ge=1.0, le=120.0)] = 30.0
    fov_y_deg: Annotated[float, Field(gt=1.0, lt=170.0)] = 45.0
    intrinsics: Annotated[tuple[Real, ...], Field(min_length=9, max_length=9)] | None = None
    distortion: Annotated[tuple[Real, ...], Field(max_length=5)] = ()
    stamped: bool = False
    format: Literal["jpeg", "h264"] = "jpeg"
    quality: Annotated[int, Field(ge=10, le=95)] = 85

    @property
    def K(self) -> tuple[float, ...]:
        """The camera matrix (9,), row-major, px."""
        if self.intrinsics is not None:
            return self.intrinsics
        f = 0.5 * self.height / math.tan(0.5 * math.radians(self.fov_y_deg))
        return f, 0.0, 0.5 * self.width, 0.0, f, 0.5 * self.height, 0.0, 0.0, 1.0

    @property
    def pose(self) -> tuple[float, ...]:
        """T_world_camera (7,): m, wxyz."""
        return *self.position, *self.orientation_wxyz
