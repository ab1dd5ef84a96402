"""AprilTags by a camera: a process that finds one tag in each picture, by OpenCV, and passes its pose on.

It sends to a TrackerLink (hal.tracker_link), in the camera's optical frame (x right, y down, z ahead), with the host's
time at which the picture was taken. The tag's own frame: x to its right, y up, z out of it, its origin in the middle.
"""

import json
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from hal.tracker import TagCamera, TrackerRequest
from hal.trackers.process import PoseSender, TrackerProcess, note, ready

PICTURE = struct.Struct("<qii")  # in front of a grey picture that a program sends: time.monotonic_ns, width, height
_LONGEST_STAMP_S = 1.0  # a driver's stamp that is further from now is of another clock
_AGAIN_S = 1.0
# of the reprojection, px: more is another thing than a tag, or a camera with other intrinsics; ours
WORST_PX = 2.0
# of a side: how far beside it brightening is looked for, in how many places, and how much of it, grey levels
_ACROSS_PX, _POINTS, _LEAST_STEP = 3.0, 48, 20.0


def detector(camera: TagCamera) -> Callable[[NDArray[np.uint8]], dict[int, Array]]:
    """Return what finds tags in a grey picture (height, width): T_camera_tag (4, 4), m, by the tags' numbers; none of a
    number that is seen twice.

    Raises ImportError where OpenCV is not installed.
    """
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 4
    families = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_APRILTAG_{camera.family}"))
    finder = cv2.aruco.ArucoDetector(families, parameters)
    half, K, distortion = camera.tag_size / 2.0, camera.matrix, np.array(camera.distortion)
    corners_of_tag = np.array([(-half, half, 0.0), (half, half, 0.0), (half, -half, 0.0), (-half, -half, 0.0)])

    def find(picture: NDArray[np.uint8]) -> dict[int, Array]:
        corners, ids, _ = finder.detectMarkers(picture)
        numbers: list[int] = [] if ids is None else [int(number) for number in ids.ravel()]
        found: dict[int, Array] = {}
        for number, four in zip(numbers, corners, strict=True):
            if numbers.count(number) > 1:
                continue  # which of them is on the object?
            seen = _met(picture, four.reshape(4, 2).astype(float), cv2.remap)
            if seen is None:
                continue
            square = cv2.SOLVEPNP_IPPE_SQUARE
            ok, turns, places, errors = cv2.solvePnPGeneric(corners_of_tag, seen, K, distortion, flags=square)
            if ok and float(np.ravel(errors)[0]) <= WORST_PX:  # the better one of the two that a square allows
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = cv2.Rodrigues(turns[0])[0], places[0].ravel()
                found[number] = T
        return found

    return find


def _met(picture: NDArray[np.uint8], corners: Array, remap: Callable[..., Any]) -> Array | None:
    """Return where the lines through a square's four sides meet, (4, 2) px; None where a side is not to be seen.
    corners (4, 2): roughly; OpenCV's own refinement pulls them inwards by 0.1 px, which is 1 mm in depth. A side has
    many points, each the mean place of the brightening across it."""
    middle, lines = corners.mean(axis=0), []
    across = np.arange(-_ACROSS_PX, _ACROSS_PX + 0.01, 0.25)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        out = np.array([along[1], -along[0]])
        out *= np.sign(out @ (a - middle))
        points = a + np.linspace(0.12, 0.88, _POINTS)[:, None] * (b - a)
        places = (points[:, None] + across[:, None] * out).astype(np.float32)
        grey = remap(picture, places[..., 0], places[..., 1], 1).astype(float)  # linear
        brighter = np.clip(np.diff(grey, axis=1), 0.0, None)
        total = brighter.sum(axis=1)
        clear = total > _LEAST_STEP
        if np.count_nonzero(clear) < _POINTS // 2:
            return None
        edge = points + (brighter @ (across[1:] + across[:-1]) / 2.0 / np.maximum(total, 1e-9))[:, None] * out
        centre = edge[clear].mean(axis=0)
        normal = np.linalg.svd(edge[clear] - centre)[2][1]
        lines.append((normal, normal @ centre))
    pairs = zip(np.roll(np.arange(4), 1), range(4), strict=True)
    try:
        return np.array([np.linalg.solve(*map(np.array, zip(lines[i], lines[k], strict=True))) for i, k in pairs])
    except np.linalg.LinAlgError:  # sides that are parallel
        return None


def _sent(camera: TagCamera) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield pictures of a program and when they were taken, time.monotonic_ns. Raises OSError at its end."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.connect(camera.source.removeprefix("unix:"))
        with connection.makefile("rb") as stream:
            while True:
                stamp_ns, width, height = PICTURE.unpack(_exactly(stream, PICTURE.size))
                if (width, height) != camera.size:
                    raise OSError(f"pictures of {width} x {height} arrive, {camera.size} are expected")
                yield stamp_ns, np.frombuffer(_exactly(stream, width * height), np.uint8).reshape(height, width)


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise OSError("the program that sends pictures has ended")
    return data


def _filmed(camera: TagCamera) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield those of a device, as `_sent` does."""
    import cv2

    film = cv2.VideoCapture(int(camera.source) if camera.source.isdecimal() else camera.source)
    if not film.isOpened():
        raise OSError(f"OpenCV cannot open {camera.source}")
    film.set(cv2.CAP_PROP_FRAME_WIDTH, camera.size[0])
    film.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.size[1])
    film.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    if camera.rate_hz:
        film.set(cv2.CAP_PROP_FPS, camera.rate_hz)
    try:
        while film.grab():
            now_ns = time.monotonic_ns()
            driver_ns = round(1e6 * film.get(cv2.CAP_PROP_POS_MSEC))  # V4L2: of the monotonic clock
            ok, picture = film.retrieve()
            if not ok or picture.shape[1::-1] != camera.size:
                raise OSError(f"{camera.source} gives no pictures of {camera.size}")
            stamped = 0 <= now_ns - driver_ns < 1e9 * _LONGEST_STAMP_S
            yield (driver_ns if stamped else now_ns), np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
    finally:
        film.release()
    raise OSError(f"{camera.source} gives no more pictures")


class AprilTagTracker(TrackerProcess):
    """A hal.tracker.ClosableTracker: one tag, seen by a camera."""

    def __init__(self, request: TrackerRequest) -> None:
        """Start the process. Raises OSError, ValueError for a request without camera or tag, or without OpenCV."""
        if request.camera is None:
            raise ValueError("a tag is seen by a camera: [tracker.camera], see docs/howto/tracker.md")
        try:
            detector(request.camera)
        except ImportError:
            raise ValueError("tags are found by OpenCV: pip install rtstack[apriltag]") from None
        super().__init__(request, "hal.trackers.apriltag", json.dumps(asdict(request.camera)), str(request.body))


def watch(camera: TagCamera, tag: int, listener: tuple[str, int]) -> None:
    """Look at pictures and send the tag's poses, until the source ends. Raises OSError."""
    find, sender = detector(camera), PoseSender(listener)
    pictures = _sent if camera.source.startswith("unix:") else _filmed
    for stamp_ns, picture in pictures(camera):
        found = find(picture)
        T = found.get(tag)
        if T is None:
            there = ", ".join(map(str, sorted(found))) or "none"
            note(f"shows no tag {tag} of family {camera.family} in its pictures; tags found: {there}", body=True)
        else:
            note("")
            sender.send(stamp_ns, T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True))


def main() -> None:
    """Pass poses on until the process that has asked for them ends. Arguments: camera as JSON, tag, host, port."""
    described, tag, host, port = sys.argv[1:]
    camera, said = TagCamera(**json.loads(described)), ""
    detector(camera)
    ready()
    note("has sent no picture yet: look at the program or the camera that sends them")
    while True:
        try:
            watch(camera, int(tag), (host, int(port)))
        except OSError as error:
            note(f"gives no pictures: {error}; look at [tracker.camera] source and at the camera")
            if str(error) != said:
                said = str(error)
                print(f"camera {camera.source}: {said}; trying again", file=sys.stderr, flush=True)
        time.sleep(_AGAIN_S)


if __name__ == "__main__":
    main()
