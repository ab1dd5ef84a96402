"""The log process: rings in, MCAP out. Started by rtstack.log.writer with two open files, never by hand.

It ends on request, or when its parent is gone, and finishes the file either way. All that may block happens here.
"""

import os
import pickle
import signal
import sys
import time
import traceback

import numpy as np
from numpy.typing import NDArray

from hal.base.realtime import ordinary_thread
from hal.base.shared import remove_block
from rtstack.log.ring import LogState, Rings
from rtstack.log.writing.job import Evidence, LogJob
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log.writing.pictures import PictureDrain
from rtstack.topics import EVENT_TOPIC, TICK_TOPICS, TOPICS

POLL_S = 0.04  # forty records a topic at 1 kHz: enough for a batch, little for a ring, a tenth of what may be lost
_FAR_FUTURE_NS = np.iinfo(np.int64).max
_NOTHING_YET_NS = np.iinfo(np.int64).min


class RingDrain:
    """Moves what is in the rings into the file, a batch at a time."""

    def __init__(self, rings: Rings, writer: McapWriter, pictures: PictureDrain) -> None:
        self._rings = rings
        self._writer, self._pictures = writer, pictures
        self._readers = {topic: rings.log_reader(topic) for topic in TOPICS}
        self._held = {name: np.zeros(0, topic.record) for name, topic in TOPICS.items()}
        self._newest = dict.fromkeys(TICK_TOPICS, _NOTHING_YET_NS)

    def step(self, final: bool = False) -> None:
        """Read every ring and write what was in it, in order of robot's time; `final` holds nothing back."""
        self._writer.write(self._settled({topic: reader.drain() for topic, reader in self._readers.items()}, final))
        newest_ns = max(0, *self._newest.values())
        made, said = self._pictures.step(newest_ns), self._pictures.events(newest_ns)
        if made or len(said):
            self._writer.write({EVENT_TOPIC: said}, made)
        self._rings.messages = sum(self._writer.messages.values())
        self._writer.flush_if_due()

    def _settled(self, batches: dict[str, NDArray], final: bool) -> dict[str, NDArray]:
        """Hold back what is not older than the newest tick of every topic. What a tick says, it says before the next
        tick's samples: what is older is complete, whenever the rings are read."""
        for topic in TICK_TOPICS:
            if len(batches[topic]):
                self._newest[topic] = int(batches[topic]["t_ns"][-1])
        limit = _FAR_FUTURE_NS if final else min(self._newest.values())
        ready = {}
        for topic, records in batches.items():
            known = np.concatenate([self._held[topic], records])
            settled = known["t_ns"] < limit
            ready[topic], self._held[topic] = known[settled], known[~settled]
        return ready

    def finish(self, result: dict[str, str], ended: str, evidence: Evidence | None = None) -> None:
        """Write what is left, result, evidence and the account of what was lost, and finish the file."""
        self.step(final=True)
        lost = {topic: reader.lost for topic, reader in self._readers.items()}
        self._writer.finish(result, ended, evidence, lost | self._pictures.lost)


def run(job_descriptor: int, log_descriptor: int, parent: int) -> None:
    """Write one log. Raises OSError when the disk refuses."""
    told = open(f"/proc/self/fd/{job_descriptor}", "rb")  # noqa: SIM115 - with a position of its own, until the end
    job: LogJob = pickle.load(told)
    rings = Rings.attach(job.rings)
    try:
        with os.fdopen(log_descriptor, "wb") as file:
            writer = McapWriter.of_job(file, job, rings.times)
            writer.flush()
            drain = RingDrain(rings, writer, PictureDrain(job.cameras, file))
            rings.state = LogState.READY
            while not rings.closing and os.getppid() == parent:
                drain.step()
                time.sleep(POLL_S)
            if rings.closing:
                try:
                    result, evidence = pickle.load(told)
                except EOFError:  # the parent has none
                    result, evidence = {}, None
                drain.finish(result, "closed", evidence)
            else:
                drain.finish({}, "the program died")
                for name in (job.rings, *(camera.ring for camera in job.cameras)):
                    remove_block(name)
            file.flush()
            os.fsync(file.fileno())
        rings.state = LogState.FINISHED
    except OSError as error:
        rings.fail(error.strerror or str(error))
        raise
    except Exception as error:
        rings.fail(f"{type(error).__name__}: {error}")
        raise


def main() -> int:
    """Entry point: job descriptor, log descriptor, process id of the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then closes the log
    ordinary_thread()
    job_descriptor, log_descriptor, parent = (int(argument) for argument in sys.argv[1:])
    try:
        run(job_descriptor, log_descriptor, parent)
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # no destructor of the SDK tries the broken file again
    return 0


if __name__ == "__main__":
    sys.exit(main())
