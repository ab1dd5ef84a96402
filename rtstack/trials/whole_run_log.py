"""The log of a campaign's trial: the same file as any trial's, written in the worker once the arms are at rest.

A lockstep run waits for nobody, so nothing can block it: the run's history has all samples, and neither rings nor
the log process, whose start costs as much as half a trial, are needed. The file gets its name when it is complete, so
that a worker which is killed leaves no half log under a trial's id.
"""

import json
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from hal.description import fr3_urdf
from hal.files import replacing
from rtstack.log.batches import BatchWriter
from rtstack.log.frames import CellFrames
from rtstack.log.job import Attachment
from rtstack.log.ring import Rings
from rtstack.log.scenery import Scenery
from rtstack.log.sink import McapSink
from rtstack.loop.history import Columns, History
from rtstack.samples import SIDES
from rtstack.trials.record import TrialLog


class WholeRunLog(TrialLog):
    """The log of a run whose history is kept, written by `close`."""

    def __init__(
        self, path: Path, metadata: dict[str, dict[str, str]], attachments: list[Attachment], frames: CellFrames
    ) -> None:
        self.path = path
        self.columns: Columns | None = None
        self._history: History | None = None
        self._metadata = metadata
        self._attachments = attachments
        self._frames = frames

    def trip(self) -> None:
        """See Watchdog: nothing is written meanwhile, and nothing can fail."""

    @property
    def listening(self) -> tuple[Rings, ...]:
        """See TrialLog: nobody reads while the run goes on."""
        return ()

    def take_from(self, history: History) -> None:
        """See TrialLog."""
        self._history = history

    def wait_ready(self) -> None:
        """Nothing to wait for."""

    def wait_for_room(self) -> None:
        """There is room for the whole run."""

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the file. Returns None, or in one line why there is none. `columns` are the samples from now on."""
        try:
            # under a name of its own: a worker that was cut off may still write what another one has taken over
            with replacing(self.path) as partial, open(partial, "wb") as file:
                sink = McapSink(file)
                for name, values in self._metadata.items():
                    sink.write_metadata(name, values)
                for attachment in self._attachments:
                    sink.attach(attachment.name, attachment.media_type, attachment.data)
                values = {key: value if isinstance(value, str) else json.dumps(value) for key, value in result.items()}
                writer = BatchWriter(sink, Scenery(self._frames, fr3_urdf()))
                if self._history is not None:
                    self.columns = self._history.columns()
                    writer.write(_batches(self.columns, self._history))
                writer.finish(values, "closed", self.evidence, {})
        except OSError as error:
            return f"the log {self.path} was not written: {error.strerror or error}"
        return None

    def abandon(self) -> None:
        """Write nothing. Never raises."""


def _batches(columns: Columns, history: History) -> dict[str, NDArray]:
    """Return the records by topic, in the order of TOPICS: of records of one time the first topic comes first."""
    arms = {f"/{side}/arm": samples for side, samples in zip(SIDES, columns.arm, strict=True)}
    controls = {f"/{side}/control": samples for side, samples in zip(SIDES, columns.control, strict=True)}
    others = {"/timing": columns.timing, "/object/pose": columns.object, "/events": history.events}
    return arms | controls | others
