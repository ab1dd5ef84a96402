"""The pictures of a running job's cameras, one stream each: what is newest, as the camera's process has made it.

Each message is two numbers, float64 little-endian, and then a JPEG: when the picture is of, us of the console's clock,
as a stamp's camera_us answers it, and how old it was when it was sent, ms. The page says a word for each picture that
it has got: no more than WINDOW are on their way, so that a slow network makes fewer pictures, and not older ones.
"""

import asyncio
import contextlib
import struct
import time

from fastapi import APIRouter, WebSocket

from console.live.watch import Watch
from console.parts import parts_of, session_now
from console.routes.sockets import SIGNED_OUT, listening
from rtstack.cameras.newest import NewestPictures, Picture

router = APIRouter(prefix="/api/cameras", tags=["robot"])

HEAD = struct.Struct("<dd")
WINDOW = 2
_LOOK_S = 0.004  # between two looks for a new picture
_EVER_NS = 1 << 62
_REST_S = 0.1  # while there is none to be expected


@router.websocket("/{camera}")
async def stream(websocket: WebSocket, camera: str) -> None:
    """Send a camera's pictures while a job runs, and wait for the next job otherwise, until the page closes."""
    parts = parts_of(websocket)
    await websocket.accept()
    if camera not in parts.cell.cameras:
        await websocket.close(1008, "the cell has no such camera")
        return
    window, pictures = asyncio.Semaphore(WINDOW), _Pictures(parts.watch, camera)
    try:
        async with listening(websocket, lambda _: window.release()) as client:
            client.add_done_callback(lambda _: window.release())
            while True:
                await window.acquire()
                while (message := pictures.next()) is None and not client.done():
                    await asyncio.sleep(_REST_S if pictures.ring is None else _LOOK_S)
                if message is None or session_now(websocket) is None:
                    break
                await websocket.send_bytes(message)
            await websocket.close(*SIGNED_OUT)
    finally:
        pictures.close()


class _Pictures:
    """What a camera shows now: its ring is another one in each job."""

    def __init__(self, watch: Watch, camera: str) -> None:
        self._watch, self._camera = watch, camera
        self._arm = watch.rings.reader(f"/{watch.sides[0]}/arm")
        self.ring: str | None = None  # its name, None while there is no picture
        self._pictures = NewestPictures({})
        self._sent: Picture | None = None

    def next(self) -> bytes | None:
        """Return the message of the newest picture, None where it was sent already, or there is none."""
        name = self._watch.cameras().get(self._camera)
        if name != self.ring:
            self.close()
            with contextlib.suppress(OSError):  # the job has just ended
                self._pictures = NewestPictures({} if name is None else {self._camera: name})
                self.ring = name
        picture, arm = self._pictures.at(_EVER_NS).get(self._camera), self._arm.latest()
        if picture is None or picture is self._sent or arm is None:
            return None
        self._sent = picture
        old_ns = max(0, int(arm["t_ns"][0]) - picture.t_ns)  # by the robot's clock, which the pictures have
        return HEAD.pack((time.monotonic_ns() - old_ns) // 1000, old_ns * 1e-6) + picture.jpeg

    def close(self) -> None:
        """Let go of the ring."""
        self._pictures.close()
        self._pictures, self.ring = NewestPictures({}), None
