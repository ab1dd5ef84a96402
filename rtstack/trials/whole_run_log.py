"""The log of a campaign's trial: the same file as any trial's, written in the worker once the arms are at rest.

A lockstep run has no deadline, so nothing can delay it: the run's history has all samples, and neither rings nor
the log process, whose start costs as much as half a trial, are needed. The file gets its name when it is complete, so
that a worker which is killed leaves no half log under a trial's id.
"""

from pathlib import Path
from typing import Any

from hal.files import replacing
from rtstack.log.batches import BatchWriter
from rtstack.log.frames import CellFrames
from rtstack.log.job import Attachment
from rtstack.log.mcap_writer import McapWriter
from rtstack.log.scenery import Scenery
from rtstack.trials.record import RunSamples


class WholeRunLog(RunSamples):
    """The log of a run whose history is kept, written by `close`."""

    def __init__(
        self, path: Path, metadata: dict[str, dict[str, str]], attachments: list[Attachment], frames: CellFrames
    ) -> None:
        super().__init__(path)
        self._metadata = metadata
        self._attachments = attachments
        self._frames = frames

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the file. Returns None, or in one line why there is none. `columns` are the samples from now on."""
        super().close(result)
        try:
            # under a name of its own: a worker that was cut off may still write what another one has taken over
            with replacing(self.path) as partial, open(partial, "wb") as file:
                mcap = McapWriter(file)
                mcap.begin(self._metadata.items(), self._attachments)
                writer = BatchWriter(mcap, Scenery(self._frames))
                if self.history is not None:
                    writer.write(self.history.batches())
                writer.finish(result, "closed", self.evidence, {})
        except OSError as error:
            return f"the log {self.path} was not written: {error.strerror or error}"
        return None
