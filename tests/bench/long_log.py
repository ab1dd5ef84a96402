"""A long log for the review: real trials' logs, one behind the other, until the minutes are full.

`python tests/bench/long_log.py OUT.mcap LOG.mcap... --minutes 10`: samples, events and frames are those of the given
logs, moved in time; what was asked and what came out is the first one's.
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log
from rtstack.log.sink import TRANSFORMS, McapSink
from rtstack.samples import TOPICS

_TICK_NS = 1_000_000
_BATCH_NS = 250_000_000  # what the sink makes a chunk of


def write_long_log(path: Path, sources: list[Path], minutes: float) -> int:
    """Write the log and return its length in ticks of the left arm."""
    logs = [read_log(source) for source in sources]
    contents = [{topic: log.topic(topic) for topic in TOPICS} for log in logs]
    transforms = [log.messages(TRANSFORMS) for log in logs]
    ticks, offset_ns, end_ns = 0, 0, int(minutes * 60e9)
    with open(path, "wb") as file:
        sink = McapSink(file)
        sink.write_metadata("trial", logs[0].metadata["trial"])
        for attachment in logs[0].attachments:
            sink.attach(attachment.name, attachment.media_type, attachment.data)
        for log, columns, frames in itertools.cycle(zip(logs, contents, transforms, strict=True)):
            if offset_ns >= end_ns:
                break
            length_ns = int(columns["/left/arm"]["t_ns"][-1]) - log.start_ns + _TICK_NS
            shift = offset_ns - log.start_ns
            for start in range(log.start_ns, log.start_ns + length_ns, _BATCH_NS):
                batches = {}
                for topic, records in columns.items():
                    part = records[(records["t_ns"] >= start) & (records["t_ns"] < start + _BATCH_NS)].copy()
                    part["t_ns"] += shift
                    batches[topic] = part
                due = [(t_ns + shift, message) for t_ns, message in frames if start <= t_ns < start + _BATCH_NS]
                sink.write(batches, due)
                ticks += len(batches["/left/arm"])
            offset_ns += length_ns
        sink.write_metadata("result", logs[0].metadata.get("result", {}))
        sink.close()
    return ticks


def main() -> int:
    """Write one log."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--minutes", type=float, default=10.0)
    options = parser.parse_args()
    ticks = write_long_log(options.output, options.logs, options.minutes)
    print(f"{options.output}: {ticks} ticks, {np.round(options.output.stat().st_size / 1e6)} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
