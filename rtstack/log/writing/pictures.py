"""Pictures on their way into the log: a ring in shared memory for each camera, and what the log process makes of it.

A camera's process writes, the log process reads. A picture that finds no room for a second is lost, and counted.
Where a camera says nothing more, or the disk is nearly full, the log goes on without pictures, and an event says so.
"""

import os
import secrets
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import foxglove
import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray

from hal.base.shared import Block
from rtstack.log.errors import LogError
from rtstack.log.viewers.frames import WORLD, stamp
from rtstack.samples import EVENT, Level

SLOTS = 32  # of a camera: about a second
LARGEST_BYTES = 512 * 1024  # of a picture
PATIENCE_S = 1.0  # of a camera that waits for room
STALL_S = 1.0  # without a picture of a camera that has given one
FIRST_S = 15.0  # until the first one
RESERVE_BYTES = 256 * 1024 * 1024  # of the disk: below it there are no more pictures, so that the samples go on

_POLL_S = 0.005
_SLOT = np.dtype([("sequence", "i8"), ("t_ns", "i8"), ("size", "i8"), ("data", "u1", LARGEST_BYTES)])
_HEAD = np.dtype([("written", "i8"), ("read", "i8"), ("ready", "i8"), ("raised", "i8"), ("error", "S800")])


class PictureRing:
    """The newest pictures of a camera: JPEG, or parts of H.264. Its creator closes it last."""

    def __init__(self, block: Block) -> None:
        self.name, self._block = block.name, block
        self._head: NDArray[Any] = np.frombuffer(block.memory, _HEAD, 1)
        self._slots: NDArray[Any] = np.frombuffer(block.memory, _SLOT, SLOTS, _HEAD.itemsize)
        self._read = 0
        self.lost = 0

    @classmethod
    def create(cls) -> "PictureRing":
        """Create an empty ring. Raises LogError where shared memory is exhausted."""
        name, size = f"rtstack-{os.getpid()}-{secrets.token_hex(4)}", _HEAD.itemsize + SLOTS * _SLOT.itemsize
        try:
            return cls(Block.create(name, size))
        except OSError as error:
            raise LogError(f"no shared memory for a camera ({size / 1e6:.0f} MB): {error.strerror}") from None

    @classmethod
    def attach(cls, name: str) -> "PictureRing":
        """Attach to the ring of another process. Raises OSError."""
        return cls(Block.attach(name))

    @property
    def error(self) -> str:
        """Why the camera gives no more pictures, empty while it does."""
        return bytes(self._head["error"][0]).decode("utf-8", "replace")

    @property
    def ready(self) -> bool:
        return bool(self._head["ready"][0])

    def opened(self) -> None:
        self._head["ready"][0] = 1

    @property
    def raised(self) -> str:
        """What the camera's program has raised, which ends the run, empty while it has not."""
        return self.error if self._head["raised"][0] else ""

    def fail(self, reason: str, raised: bool = False) -> None:
        """Say why there are no more pictures. raised: by a mistake of the camera's program."""
        self._head["error"][0], self._head["raised"][0] = reason.encode("utf-8"), raised

    def write(self, t_ns: int, picture: bytes) -> None:
        """Add a picture at the log's time t_ns, once there is room, or over the oldest one; none that is too large."""
        if len(picture) > LARGEST_BYTES:
            return
        count, until_s = int(self._head["written"][0]), time.monotonic() + PATIENCE_S
        while count - int(self._head["read"][0]) >= SLOTS and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        slot = self._slots[count % SLOTS]
        slot["sequence"] = -1
        slot["t_ns"], slot["size"] = t_ns, len(picture)
        slot["data"][: len(picture)] = np.frombuffer(picture, np.uint8)
        slot["sequence"] = count
        self._head["written"][0] = count + 1

    def drain(self) -> list[tuple[int, bytes]]:
        """Return the pictures since the last call, (t_ns, JPEG) each."""
        found, written = self.since(self._read)
        self.lost += written - self._read - len(found)
        self._read = self._head["read"][0] = written
        return found

    def since(self, number: int) -> tuple[list[tuple[int, bytes]], int]:
        """Return the pictures from a number on that are still there, and the number of the next one: for who looks on
        beside the log, whose reading this does not change."""
        written = int(self._head["written"][0])
        found = []
        for each in range(max(number, written - SLOTS), written):
            slot = self._slots[each % SLOTS]
            picture = int(slot["t_ns"]), slot["data"][: int(slot["size"])].tobytes()
            if int(slot["sequence"]) == each:
                found.append(picture)
        return found, written

    def close(self) -> None:
        """Let go of the memory; the owner also removes it."""
        self._head = self._slots = np.zeros(0)
        self._block.close()


def camera_topics(name: str) -> tuple[str, str, str]:
    """Return the topics of a camera's pictures, its calibration and its frame."""
    return f"/camera/{name}/image", f"/camera/{name}/calibration", f"/camera/{name}/tf"


def camera_schemas(name: str, video: bool = False) -> dict[str, foxglove.Schema]:
    """Return the schema of each of a camera's topics. video: its pictures are H.264."""
    kinds = (fox.CompressedVideo if video else fox.CompressedImage, fox.CameraCalibration, fox.FrameTransforms)
    return {topic: kind.get_schema() for topic, kind in zip(camera_topics(name), kinds, strict=True)}


def picture_message(name: str, t_ns: int, picture: bytes, video: bool = False) -> bytes:
    """Return the message of a camera's picture, JPEG, or a part of H.264 where it is video."""
    kind, form = (fox.CompressedVideo, "h264") if video else (fox.CompressedImage, "jpeg")
    return kind(timestamp=stamp(t_ns), frame_id=f"camera_{name}", data=picture, format=form).encode()


@dataclass(frozen=True, slots=True)
class LoggedCamera:
    """A camera as the log process needs it. ring: its name; K (9,): row-major, px; pose (7,): T_world_camera, m, wxyz,
    looking along its z, its x to the picture's right. video: its pictures are H.264."""

    name: str
    ring: str
    width: int
    height: int
    K: tuple[float, ...]
    D: tuple[float, ...]
    pose: tuple[float, ...]
    video: bool = False

    @property
    def topics(self) -> tuple[str, str, str]:
        """Its pictures, its calibration and its frame."""
        return camera_topics(self.name)

    def about(self, t_ns: int) -> dict[str, list[tuple[int, bytes]]]:
        """Return its calibration and its frame."""
        _, calibration, frame = self.topics
        name, k, (x, y, z, qw, qx, qy, qz) = f"camera_{self.name}", self.K, self.pose
        said = fox.CameraCalibration(
            timestamp=stamp(t_ns), frame_id=name, width=self.width, height=self.height,
            distortion_model="plumb_bob" if self.D else "", D=list(self.D), K=list(k),
            R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            P=[k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0],
        )  # fmt: skip
        place = fox.FrameTransform(
            timestamp=stamp(t_ns), parent_frame_id=WORLD, child_frame_id=name,
            translation=fox.Vector3(x=x, y=y, z=z), rotation=fox.Quaternion(x=qx, y=qy, z=qz, w=qw),
        )  # fmt: skip
        return {calibration: [(t_ns, said.encode())], frame: [(t_ns, fox.FrameTransforms(transforms=[place]).encode())]}


class PictureDrain:
    """Moves pictures from their rings into messages, and notices a camera that is quiet, and a disk that is full."""

    def __init__(self, cameras: Sequence[LoggedCamera], file: BinaryIO) -> None:
        self._cameras = [(camera, PictureRing.attach(camera.ring)) for camera in cameras]
        self._file = file
        now_s = time.monotonic()
        self._due_s = {camera.name: now_s + FIRST_S for camera in cameras}
        self._last_ns: dict[str, int] = {}  # of the newest picture
        self._known: set[str] = set()  # whose calibration was written
        self._quiet: set[str] = set()
        self._full = False
        self._events: list[tuple[Level, str]] = []

    def step(self, newest_ns: int) -> dict[str, list[tuple[int, bytes]]]:
        """Return the messages since the last call, by topic. newest_ns: of the newest sample: a camera is not asked for
        more than the samples that it could have seen."""
        made: dict[str, list[tuple[int, bytes]]] = {}
        if self._cameras and not self._full:
            disk = os.fstatvfs(self._file.fileno())
            self._full = disk.f_bavail * disk.f_frsize < RESERVE_BYTES
            if self._full:
                text = f"no more pictures: the disk has less than {RESERVE_BYTES >> 20} MB"
                self._events.append((Level.WARNING, text))
        for camera, ring in self._cameras:
            pictures = ring.drain()
            if pictures and not self._full:
                if camera.name not in self._known:
                    self._known.add(camera.name)
                    made |= camera.about(pictures[0][0])
                made[camera.topics[0]] = [
                    (t_ns, picture_message(camera.name, t_ns, picture, camera.video)) for t_ns, picture in pictures
                ]
            if pictures:
                self._last_ns[camera.name] = pictures[-1][0]
            late = newest_ns - self._last_ns.get(camera.name, 0) > STALL_S * 1e9
            self._watch(camera.name, ring, bool(pictures), late)
        return made

    def _watch(self, name: str, ring: PictureRing, alive: bool, late: bool) -> None:
        now_s = time.monotonic()
        if alive:
            self._due_s[name] = now_s + STALL_S
            if name in self._quiet:
                self._quiet.discard(name)
                self._events.append((Level.INFO, f"camera {name}: pictures again"))
        elif name not in self._quiet and ((late and now_s > self._due_s[name]) or ring.error):
            self._quiet.add(name)
            why = ring.error or "it gives none any more"
            self._events.append((Level.WARNING, f"camera {name}: no picture: {why}"))

    def events(self, t_ns: int) -> NDArray[np.void]:
        """Return what was noticed since the last call, (n,) of EVENT."""
        events = np.zeros(len(self._events), EVENT)
        for event, (level, text) in zip(events, self._events, strict=True):
            event["t_ns"], event["level"], event["name"] = t_ns, level, b"camera"
            event["text"] = text.encode("ascii", "replace")
        self._events.clear()
        return events

    @property
    def lost(self) -> dict[str, int]:
        return {camera.topics[0]: ring.lost for camera, ring in self._cameras}

    def close(self) -> None:
        for _, ring in self._cameras:
            ring.close()
