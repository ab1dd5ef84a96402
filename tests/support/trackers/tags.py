"""Pictures of tags, drawn from a pose by the pinhole model; and a program that sends pictures."""

import contextlib
import os
import socket
import struct
import tempfile
import threading
from pathlib import Path

import cv2
import numpy as np

from hal.tracker import TagCamera

CAMERA = TagCamera("0", (640, 480), (700.0, 700.0), (319.5, 239.5), tag_size=0.12)
_PIXELS, _FINER = 400, 3  # of the texture's black square; drawn so many times finer than the picture


def texture(camera: TagCamera, number: int) -> np.ndarray:
    """Return a tag with a white margin, a quarter of its size wide, (n, n)."""
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_APRILTAG_{camera.family}"))
    return np.pad(cv2.aruco.generateImageMarker(family, number, _PIXELS), _PIXELS // 4, constant_values=255)


def looking_at(place: tuple[float, float, float], target: tuple[float, float, float]) -> np.ndarray:
    """Return T_world_camera (4, 4), optical: x right, y down, z ahead, the world's z up in the picture."""
    ahead = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([right, np.cross(ahead, right), ahead]), place
    return T


def picture(camera: TagCamera, tags: dict[int, np.ndarray], rng: np.random.Generator | None = None) -> np.ndarray:
    """Draw tags at T_camera_tag (4, 4) on grey, (height, width), without distortion; with a camera's noise by rng."""
    width, height = camera.size
    small = np.full((height, width), 128, np.uint8)
    K = camera.matrix.copy()
    K[:2] *= _FINER
    K[:2, 2] += (_FINER - 1) / 2.0  # a pixel's middle stays its middle
    for number, T in tags.items():
        drawing = texture(camera, number)
        metres = camera.tag_size / _PIXELS  # of a texture's pixel
        middle = (len(drawing) - 1) / 2.0
        on_tag = np.array([[metres, 0.0, -middle * metres], [0.0, -metres, middle * metres], [0.0, 0.0, 1.0]])
        H = K @ T[:3, [0, 1, 3]] @ on_tag
        corners = H @ [[0, 2 * middle, 2 * middle, 0], [0, 0, 2 * middle, 2 * middle], [1, 1, 1, 1]]
        seen = corners[:2] / corners[2] / _FINER
        left, top = np.clip(np.floor(seen.min(axis=1)).astype(int) - 1, 0, (width - 1, height - 1))
        right, bottom = np.clip(np.ceil(seen.max(axis=1)).astype(int) + 2, (left + 1, top + 1), (width, height))
        part = small[top:bottom, left:right]  # the rest stays as it is: a tag is a small part of a picture
        finer = np.repeat(np.repeat(part, _FINER, axis=0), _FINER, axis=1)
        H = np.array([[1.0, 0.0, -left * _FINER], [0.0, 1.0, -top * _FINER], [0.0, 0.0, 1.0]]) @ H
        cv2.warpPerspective(
            drawing, H, finer.shape[::-1], dst=finer, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_TRANSPARENT
        )
        small[top:bottom, left:right] = cv2.resize(finer, part.shape[::-1], interpolation=cv2.INTER_AREA)
    if rng is None:
        return small
    return np.clip(small + rng.normal(0.0, 2.0, small.shape), 0, 255).astype(np.uint8)


class Sender:
    """A program that has a camera, and sends its pictures to one client."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp(prefix="rtstack-tags-")
        self._path = Path(self._folder) / "camera.sock"
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._server.bind(str(self._path))
        self._server.listen(1)
        self._client: socket.socket | None = None
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()
        self.source = f"unix:{self._path}"

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            self._client = self._server.accept()[0]

    @property
    def connected(self) -> bool:
        """Whether the client has connected."""
        return self._client is not None

    def send(self, stamp_ns: int, grey: np.ndarray) -> None:
        """Send a picture, if the client has connected."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                height, width = grey.shape
                self._client.sendall(struct.pack("<qii", stamp_ns, width, height) + grey.tobytes())

    def close(self) -> None:
        """End."""
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join()
        if self._client is not None:
            self._client.close()
        self._path.unlink()
        os.rmdir(self._folder)
