"""Starts the cameras of a run, and ends them."""

import contextlib
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

from rtstack.cameras.newest import NewestPictures
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.log.writing.pictures import LoggedCamera, PictureRing
from rtstack.model.cell_description import CellDescription

_OPEN_S = 20.0  # for a camera to open: a program starts, and MuJoCo's drawing
_POLL_S = 0.005
_END_S = 20.0  # for the pictures that are still to be made


class Cameras:
    """The cameras' processes of one run, and their rings."""

    def __init__(self, description: CellDescription, cell_file: Path, object_name: str, rings: Rings) -> None:
        self._processes: list[subprocess.Popen[bytes]] = []
        self._rings: list[PictureRing] = []
        self._periods_ns = {name: round(1e9 / each.rate_hz) for name, each in description.cameras.items()}
        logged = []
        for name, camera in description.cameras.items():
            try:
                ring = PictureRing.create()
            except LogError:
                self.finish()
                self.close()
                rings.close()
                raise
            self._rings.append(ring)
            logged.append(LoggedCamera(
                name, ring.name, camera.width, camera.height, camera.K, camera.distortion,
                camera.pose, camera.format == "h264",
            ))  # fmt: skip
            job = {
                "name": name, "camera": asdict(camera), "pictures": ring.name, "rings": rings.name,
                "cell_file": str(cell_file), "object": object_name, "parent": os.getpid(),
            }  # fmt: skip
            command = [sys.executable, "-m", "rtstack.cameras.process", json.dumps(job)]
            self._processes.append(subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            ))  # fmt: skip
        self.logged = tuple(logged)

    @property
    def rings(self) -> dict[str, str]:
        """The name of each camera's ring, by the camera's."""
        return {camera.name: camera.ring for camera in self.logged}

    def newest(self) -> NewestPictures:
        """Return what they show, for who looks on in this process."""
        return NewestPictures(self.rings, self._periods_ns)

    @property
    def raised(self) -> str:
        """What the program of a camera has raised, "" while none has."""
        return next((ring.raised for ring in self._rings if ring.raised), "")

    def wait_ready(self) -> None:
        """Wait until each camera is open or has failed, before an arm moves; one that takes too long is left behind."""
        until_s = time.monotonic() + _OPEN_S
        for process, ring in zip(self._processes, self._rings, strict=True):
            while not ring.ready and not ring.error and process.poll() is None and time.monotonic() < until_s:
                time.sleep(_POLL_S)

    def finish(self) -> None:
        """Have what was seen so far made into pictures, and end the processes. One that died before says so."""
        for process, ring in zip(self._processes, self._rings, strict=True):
            code = process.poll()
            if code and not ring.error:
                ring.fail(f"its process ended with {code}")
            process.terminate()
        for process in self._processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END_S)
            process.kill()
            process.wait()

    def close(self) -> None:
        """Remove the rings, once the log process has read them."""
        for ring in self._rings:
            ring.close()
