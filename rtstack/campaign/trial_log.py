"""The log of a campaign's trial: the same file as any trial's, written in the worker once the arms are at rest.

A lockstep run waits for nobody, so nothing can block it: the rings take the whole run, and the log process, whose start
costs as much as half a trial, is not needed. The file gets its name when it is complete, so that a worker which is
killed leaves no half log under a trial's id.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.description import fr3_urdf
from rtstack.log.frames import CellFrames, FrameTree
from rtstack.log.job import Attachment
from rtstack.log.process import LogWriter
from rtstack.log.ring import Rings
from rtstack.log.sink import McapSink
from rtstack.loop.history import Columns
from rtstack.samples import SIDES
from rtstack.trials.record import TrialLog

EVENTS = 1024  # records: a trial has some ten
PARTIAL = ".part"


class WholeRunLog(TrialLog):
    """Rings that take a run of at most `ticks`, and its log, written by `close`."""

    def __init__(
        self,
        path: Path,
        ticks: int,
        metadata: dict[str, dict[str, str]],
        attachments: list[Attachment],
        frames: CellFrames,
    ) -> None:
        """Raises LogError where shared memory is exhausted."""
        self.path = path
        self.rings = Rings.create(1 << (ticks - 1).bit_length(), {"/events": EVENTS})
        self.columns: Columns | None = None
        self._metadata = metadata
        self._attachments = attachments
        self._frames = frames

    def trip(self) -> None:
        """See Watchdog: nothing is written meanwhile, and nothing can fail."""

    def wait_ready(self) -> None:
        """Nothing to wait for."""

    def wait_for_room(self) -> None:
        """There is room for the whole run."""

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the file. Returns None, or in one line why there is none. `columns` are the samples from now on."""
        # a name of its own: a worker that was cut off may still write what another one has taken over
        partial = self.path.with_name(f"{self.path.stem}.{os.uname().nodename}-{os.getpid()}{PARTIAL}")
        try:
            with open(partial, "wb") as file:
                sink = McapSink(file)
                for name, values in self._metadata.items():
                    sink.write_metadata(name, values)
                for attachment in self._attachments:
                    sink.attach(attachment.name, attachment.media_type, attachment.data)
                values = {key: value if isinstance(value, str) else json.dumps(value) for key, value in result.items()}
                writer = LogWriter(self.rings, sink, FrameTree(self._frames, fr3_urdf()))
                self.columns = _columns(writer.finish(values, "closed", self.evidence))
            os.replace(partial, self.path)
        except OSError as error:
            partial.unlink(missing_ok=True)
            return f"the log {self.path} was not written: {error.strerror or error}"
        finally:
            self.rings.close()
        return None

    def abandon(self) -> None:
        """Write nothing. Never raises."""
        self.rings.close()


def _columns(written: dict[str, NDArray[Any]]) -> Columns:
    return Columns(
        arm=np.stack([written[f"/{side}/arm"] for side in SIDES]),
        control=np.stack([written[f"/{side}/control"] for side in SIDES]),
        timing=written["/timing"],
        object=written["/object/pose"],
    )
