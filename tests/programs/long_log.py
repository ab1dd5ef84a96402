"""A long log for the review: real trials' samples, one trial behind the other, through the real log process.

`python -m tests.programs.long_log OUT.mcap LOG.mcap... --minutes 10`: samples and events of the given logs are moved in
time and pushed into rings tick by tick, as the loop does; the log process makes the file of them, /tf included. What
was asked and what came out is the first log's. `--spike MINUTE`: one sample of the left arm's fourth torque is 400 Nm.
"""

import argparse
import itertools
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
from rich.progress import Progress

from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log.ring import Rings
from rtstack.log.writer import CellFrames, LogProcess, LogSummary
from rtstack.model.cell_description import load_cell_description
from rtstack.topics import TOPICS
from rtstack.trials.record import frames

_TICK_NS = 1_000_000
_PIECE = 1024  # ticks between two looks at how far the log process is
SPIKE_NM = 400.0


def write_long_log(path: Path, sources: list[Path], minutes: float, spike_min: float | None = None) -> LogSummary:
    """Write the log. Raises LogError where a source is none, or the log process fails."""
    logs = [read_log(source) for source in sources]
    contents = [{topic: log.topic(topic) for topic in TOPICS} for log in logs]
    first = logs[0]
    end_ns, offset_ns = int(minutes * 60e9), 0
    spike_ns = None if spike_min is None else round(spike_min * 60e3) * _TICK_NS
    with Rings.create() as rings, Progress(transient=True) as progress:
        process = LogProcess.start(
            path, rings, {"trial": first.metadata["trial"]}, first.attachments, _frames(first), overwrite=True
        )
        try:
            process.wait_ready()
            pushers = {topic: rings.pusher(topic) for topic in TOPICS}
            shown = progress.add_task("pushing", total=end_ns)
            for log, columns in itertools.cycle(zip(logs, contents, strict=True)):
                if offset_ns >= end_ns:
                    break
                length_ns = int(columns["/left/arm"]["t_ns"][-1]) - log.start_ns + _TICK_NS
                for start in range(log.start_ns, log.start_ns + length_ns, _PIECE * _TICK_NS):
                    process.wait_room(2 * _PIECE)
                    for topic, records in columns.items():
                        edges = np.searchsorted(records["t_ns"], [start, start + _PIECE * _TICK_NS])
                        part = records[edges[0] : edges[1]].copy()
                        part["t_ns"] += offset_ns - log.start_ns
                        if topic == "/left/arm" and spike_ns is not None:
                            part["tau_J"][part["t_ns"] == spike_ns, 3] = SPIKE_NM
                        record = np.zeros(1, part.dtype)
                        for row in range(len(part)):
                            record[0] = part[row]
                            pushers[topic].push(record)
                offset_ns += length_ns
                progress.update(shown, completed=offset_ns)
        except BaseException:
            process.abandon()
            raise
        return process.close(first.metadata.get("result", {}))


def _frames(log: Log) -> CellFrames:
    """What /tf is made of, from the cell's description inside a log."""
    with NamedTemporaryFile(suffix=".toml") as file:
        file.write(next(attachment.data for attachment in log.attachments if attachment.name == "cell.toml"))
        file.flush()
        return frames(load_cell_description(Path(file.name)), log.metadata["trial"]["object"])


def main() -> int:
    """Write one log."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--spike", type=float, help="when the left arm's fourth torque has a spike, min")
    options = parser.parse_args()
    try:
        summary = write_long_log(options.output, options.logs, options.minutes, options.spike)
    except LogError as error:
        print(error, file=sys.stderr)
        return 2
    size_mb = round(options.output.stat().st_size / 1e6)
    print(f"{options.output}: {summary.messages} messages, {summary.lost} lost, {size_mb} MB")
    return 1 if summary.lost else 0


if __name__ == "__main__":
    sys.exit(main())
