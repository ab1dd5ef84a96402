"""The arms of a log as they moved, as an animated picture: the simulated camera looks at the log."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from rtstack.cameras.source import CAMERAS, CameraRequest
from rtstack.cells import default_cell_file
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log.ring import Rings
from rtstack.model.camera_description import CameraDescription

MOST_PICTURES, QUALITY = 240, 60
RATE_HZ, SLOW = 12.0, 0.1  # pictures in a second of looking at it; shorter parts than a second are shown slowly
WIDTH, HEIGHT, BACKGROUND = 480, 360, 245
EYE, CENTRE = np.array([1.45, -0.75, 0.95]), np.array([-0.1, 0.0, 0.32])  # m: from before the cell, above the table


@dataclass(slots=True)
class _Topic:
    """A topic of a log, drained once, as a ring is."""

    records: NDArray[Any]

    def drain(self) -> NDArray[Any]:
        records, self.records = self.records, self.records[:0]
        return records

    def latest(self) -> NDArray[Any] | None:
        """Return the last record, shape (1,), None once they were drained."""
        return self.records[-1:] if len(self.records) else None


@dataclass(frozen=True, slots=True)
class _LogRings:
    """A part of a log in the place of a loop's rings. first_ns, last_ns: in the log's clock."""

    log: Log
    first_ns: int
    last_ns: int

    def reader(self, topic: str) -> _Topic:
        records = self.log.topic(topic)
        return _Topic(records[(records["t_ns"] >= self.first_ns) & (records["t_ns"] <= self.last_ns)])


def animate(path: Path, target: Path, first_s: float, last_s: float) -> None:
    """Write pictures of a part of a log, s after its start, as animated WebP. Raises LogError with one line."""
    log = read_log(path)
    pace = SLOW if last_s - first_s < 1.0 else 1.0
    rate_hz = min(RATE_HZ / pace, MOST_PICTURES / (last_s - first_s))
    rings = _LogRings(log, log.start_ns + round(1e9 * first_s), log.start_ns + round(1e9 * last_s))
    trial = log.metadata.get("trial", {})
    camera = CameraDescription(
        kind="simulated", position=tuple(EYE), orientation_wxyz=_looking(EYE, CENTRE), width=WIDTH, height=HEIGHT,
        rate_hz=rate_hz, fov_y_deg=40.0,
    )  # fmt: skip
    described = log.attachment("cell.toml")
    try:
        with TemporaryDirectory() as folder:
            cell_file = default_cell_file()
            if described is not None:
                cell_file = Path(folder) / "cell.toml"
                cell_file.write_bytes(described)
            request = CameraRequest("", camera, cast(Rings, rings), cell_file, str(trial.get("object", "")))
            pictures = []
            with closing(CAMERAS.load("simulated")(request)) as eye:
                while (picture := eye.read()) is not None:
                    pixels = picture[1]
                    pixels[(pixels == 0).all(axis=2)] = BACKGROUND  # where MuJoCo has drawn nothing
                    pictures.append(Image.fromarray(pixels))
        if not pictures:
            raise LogError(f"{path}: no samples of its arms in this part of it")
        duration_ms = round(1e3 / rate_hz / pace)
        pictures[0].save(
            target, save_all=True, append_images=pictures[1:], duration=duration_ms, loop=0, quality=QUALITY, method=4
        )
    except OSError as error:
        raise LogError(f"cannot write {target}: {error.strerror}" if error.strerror else str(error)) from None


def _looking(eye: NDArray[np.float64], centre: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return the orientation of optics whose z looks from eye to centre, with the world's z upwards in the picture."""
    ahead = (centre - eye) / np.linalg.norm(centre - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    matrix = np.column_stack([right, np.cross(ahead, right), ahead])
    w, x, y, z = Rotation.from_matrix(matrix).as_quat(scalar_first=True)
    return w, x, y, z
