"""Files of other writers, read by us, by mcap in Python, by @mcap/core and by Rerun: the same counts, order, times.

    mkdir /tmp/node && (cd /tmp/node && npm install @mcap/core @mcap/support @mcap/nodejs)
    python -m tests.programs.other_readers --node /tmp/node

The messages of a log of ours, with those of foreign programs, are written by mcap in Python, by the Foxglove SDK (whose
writer is the Rust one) and by @mcap/core with their options, and bags of ROS 2 beside them, with and without our topics
merged into them. Exit status 1 where a reader that reads a file finds other messages than were written.

Takes three minutes.
"""

import base64
import json
import os
import random
import subprocess
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer

from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from tests.programs import FAILED, program
from tests.support.log.samples import write_log

SCRIPT = Path(__file__).parent / "clients" / "mcap_core.cjs"
TODAY_NS = 1_795_000_000_000_000_000  # a foreign program's clock
Found = dict[str, list[tuple[int, int]]]  # log time and CRC-32 of each message of a topic, in the reader's order


@dataclass(frozen=True)
class Source:
    """What is written: channels (topic, encoding, schema's name, encoding and data) and messages of them, by number."""

    channels: list[tuple[str, str, tuple[str, str, bytes] | None]]
    messages: list[tuple[int, int, bytes]]

    def found(self) -> Found:
        """Return what a reader should find."""
        found: Found = {}
        for k, t_ns, data in sorted(self.messages, key=lambda message: message[1]):
            found.setdefault(self.channels[k][0], []).append((t_ns, zlib.crc32(data)))
        return found


def source_of(path: Path, rng: random.Random) -> Source:
    """Return a log's messages with some of other programs: of today, without schema, a second channel of a topic."""
    numbers: dict[int, int] = {}
    channels, messages = [], []
    with path.open("rb") as file:
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.id not in numbers:
                numbers[channel.id] = len(channels)
                kind = schema and (schema.name, schema.encoding, schema.data)
                channels.append((channel.topic, channel.message_encoding, kind))
            messages.append((numbers[channel.id], message.log_time, message.data))
    arm = next(k for k, channel in enumerate(channels) if channel[0] == "/left/arm")
    if rng.random() < 0.5:  # a second channel of a topic, with every third message
        channels.append(channels[arm])
        messages = [
            (len(channels) - 1 if k == arm and i % 3 == 0 else k, *rest) for i, (k, *rest) in enumerate(messages)
        ]
    channels.append(("/temperature", "json", ("temperature", "jsonschema", b'{"type": "object"}')))
    for k in range(50):
        messages.insert(rng.randrange(len(messages)), (len(channels) - 1, TODAY_NS + k * 10**7, b'{"celsius": 21.5}'))
    if rng.random() < 0.5:  # a writer that does not sort
        for _ in range(100):
            k = rng.randrange(len(messages) - 1)
            messages[k], messages[k + 1] = messages[k + 1], messages[k]
    return Source(channels, messages)


def by_python(path: Path, source: Source, options: dict[str, Any]) -> None:
    """Write with the mcap library for Python."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("", "other")
        ids = []
        for topic, encoding, schema in source.channels:
            ids.append(writer.register_channel(topic, encoding, writer.register_schema(*schema) if schema else 0))
        for k, t_ns, data in source.messages:
            writer.add_message(ids[k], t_ns, data, t_ns)
        writer.finish()


def by_foxglove(path: Path, source: Source, options: dict[str, Any]) -> None:
    """Write with the Foxglove SDK."""
    import foxglove
    from foxglove.mcap import MCAPCompression, MCAPWriteOptions

    context = foxglove.Context()
    compression = options["compression"] and getattr(MCAPCompression, options["compression"])
    chosen = MCAPWriteOptions(**options | {"compression": compression})
    writer = foxglove.open_mcap(path, context=context, writer_options=chosen)
    channels = []
    for topic, encoding, schema in source.channels:
        kind = foxglove.Schema(name=schema[0], encoding=schema[1], data=schema[2]) if schema else None
        channels.append(foxglove.Channel(topic, schema=kind, message_encoding=encoding, context=context))
    for k, t_ns, data in source.messages:
        channels[k].log(data, log_time=t_ns)
    writer.close()


def by_mcap_core(path: Path, source: Source, options: dict[str, Any]) -> None:
    """Write with @mcap/core."""
    content = {
        "channels": [
            {
                "topic": topic, "encoding": encoding,
                "schema": schema and [schema[0], schema[1], base64.b64encode(schema[2]).decode()],
            }
            for topic, encoding, schema in source.channels
        ],
        "messages": [(k, str(t_ns), base64.b64encode(data).decode()) for k, t_ns, data in source.messages],
    }  # fmt: skip
    given = path.with_suffix(".json")
    given.write_text(json.dumps(content))
    environment = os.environ | {"MCAP_CORE": options.pop("node")}
    subprocess.run(["node", SCRIPT, "write", json.dumps(options), given, path], check=True, env=environment)
    given.unlink()


def by_rosbags(path: Path, source: Source | None, options: dict[str, Any]) -> None:
    """Write a bag of ROS 2; with a source, its messages are merged into it as `mcap merge` does."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    text = types.types["std_msgs/msg/String"]
    bag = path.with_suffix("")
    writer = BagWriter(bag, version=9, storage_plugin=StoragePlugin.MCAP)
    if mode := options.get("mode"):
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        chatter = writer.add_connection("/chatter", text.__msgtype__, typestore=types)
        for k in range(300):
            writer.write(chatter, TODAY_NS + k * 10**6, types.serialize_cdr(text(data=f"{k}"), text.__msgtype__))
    made = next(each for each in bag.iterdir() if ".mcap" in each.name)
    if source is None:
        made.rename(path)
        return
    bagged = source_of_bag(made)
    shift = len(source.channels)
    merged = Source(
        source.channels + bagged.channels,
        source.messages + [(k + shift, t_ns, data) for k, t_ns, data in bagged.messages],
    )
    source.channels[:], source.messages[:] = merged.channels, sorted(merged.messages, key=lambda each: each[1])
    by_python(path, source, {})


def source_of_bag(path: Path) -> Source:
    """Return the messages of a bag."""
    with path.open("rb") as file:
        found = list(NonSeekingReader(file).iter_messages())
    schema, channel, _ = found[0]
    kind = schema and (schema.name, schema.encoding, schema.data)
    return Source(
        [(channel.topic, channel.message_encoding, kind)],
        [(0, message.log_time, message.data) for *_, message in found],
    )


def files() -> Iterator[tuple[str, Callable[..., None], dict[str, Any], bool]]:
    """Yield the name, writer and options of each file, and whether it has messages of ours."""
    everything = IndexType.ALL
    for compression in CompressionType:
        name = f"mcap Python, {compression.name.lower()}"
        chosen = {"compression": compression}
        yield name, by_python, chosen, True
        yield f"{name}, chunks of 1,000 bytes", by_python, chosen | {"chunk_size": 1000}, True
        without = IndexType(everything & ~IndexType.MESSAGE)
        yield f"{name}, no message index", by_python, chosen | {"index_types": without}, True
        yield f"{name}, no index", by_python, chosen | {"index_types": IndexType.NONE}, True
        bare = {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False}
        yield f"{name}, nothing repeated", by_python, chosen | bare, True
    yield "mcap Python, no chunks", by_python, {"use_chunking": False}, True
    for compression in (None, "Lz4", "Zstd"):
        name, chosen = f"Foxglove SDK, {compression or 'none'}", {"compression": compression}
        yield name, by_foxglove, chosen, True
        yield f"{name}, chunks of 1,000 bytes", by_foxglove, chosen | {"chunk_size": 1000}, True
        for option in (
            "emit_message_indexes",
            "emit_chunk_indexes",
            "emit_statistics",
            "emit_summary_offsets",
            "repeat_channels",
        ):
            yield f"{name}, {option} off", by_foxglove, chosen | {option: False}, True
    yield "Foxglove SDK, no chunks", by_foxglove, {"compression": None, "use_chunks": False}, True
    yield "@mcap/core", by_mcap_core, {}, True
    yield "@mcap/core, chunks of 1,000 bytes", by_mcap_core, {"chunkSize": 1000}, True
    for option in ("useChunks", "useMessageIndex", "useChunkIndex", "useStatistics", "repeatChannels", "repeatSchemas"):
        yield f"@mcap/core, {option} off", by_mcap_core, {option: False}, True
    for mode in (None, "MESSAGE", "STORAGE"):
        yield f"bag of ROS 2, {mode or 'no compression'}", by_rosbags, {"mode": mode}, False
        yield f"bag of ROS 2, {mode or 'no compression'}, merged with ours", by_rosbags, {"mode": mode}, True


def read_by_us(path: Path) -> Found:
    """Return what our reader finds. Raises LogError."""
    log = read_log(path)
    found: Found = {}
    for topic in log.topics:
        if messages := log.messages(topic):
            found[topic] = [(t_ns, zlib.crc32(data)) for t_ns, data in messages]
            if log.count(topic) != len(messages):
                found[f"count of {topic}"] = [(log.count(topic), 0)]
    return found


def read_by_python(path: Path) -> Found:
    """Return what the mcap library for Python finds, as a stream: its indexed reader drops what is in no index."""
    found: Found = {}
    with path.open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=True):
            found.setdefault(channel.topic, []).append((message.log_time, zlib.crc32(message.data)))
    return found


def read_by_rerun(path: Path) -> Found:
    """Return the times that Rerun finds, without checksums: its columns have the decoded values."""
    from rerun.chunk import McapReader

    found: Found = {}
    for chunk in McapReader(path, decoders=["raw"], timeline_type="duration_ns").stream():
        batch = chunk.to_record_batch()
        times = [name for name in batch.schema.names if name.endswith("log_time")]
        if times and any("McapMessage:data" in name for name in batch.schema.names):
            at = batch.column(times[0]).cast("int64").to_pylist()
            found.setdefault(str(chunk.entity_path), []).extend((t_ns, 0) for t_ns in at)
    return {topic: sorted(each) for topic, each in found.items()}  # a stream of chunks, in the order of the file


def read_by_mcap_core(path: Path, node: Path, expected: Found) -> str:
    """Return what comes of reading with @mcap/core: compared, or its error."""
    command, environment = ["node", SCRIPT, "read", path], os.environ | {"MCAP_CORE": str(node)}
    out = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if out.returncode:
        return next(line for line in out.stderr.splitlines() if "Error" in line)[:60]
    found = json.loads(out.stdout).items()
    in_order = {
        topic: sorted(((int(t_ns), crc) for t_ns, crc in each), key=lambda one: one[0]) for topic, each in found
    }
    return compared(in_order, expected)


def compared(found: Found, expected: Found, checks: bool = True) -> str:
    """Return "same", or what differs first. Messages of one time may come in any order."""
    for topic in sorted(found.keys() | expected.keys()):
        here, there = found.get(topic, []), expected.get(topic, [])
        if len(here) != len(there):
            return f"{topic}: {len(here)} of {len(there)}"
        if [t_ns for t_ns, _ in here] != [t_ns for t_ns, _ in there]:
            return f"{topic}: other times or order"
        if checks and Counter(here) != Counter(there):
            return f"{topic}: other data"
    return "same"


def main(node: Annotated[Path, typer.Option(help="where @mcap/core is installed")], seed: int = 0) -> int:
    """Write, read, compare. Returns 0 where nothing differs that a reader read."""
    if not (node / "node_modules/@mcap/core").is_dir():
        raise typer.BadParameter(f"there is no @mcap/core in {node}: see --help for how to install it")
    rng = random.Random(seed)
    print("| file | messages | rtstack | mcap Python | @mcap/core | Rerun |\n|---|---|---|---|---|---|")
    wrong, tally = 0, Counter[str]()
    with TemporaryDirectory() as folder:
        ours = write_log(Path(folder) / "ours.mcap", ticks=200).path
        for number, (name, write, options, merged) in enumerate(files()):
            path = Path(folder) / f"{number}.mcap"
            source = source_of(ours, rng) if merged else None
            write(path, source, options | ({"node": str(node)} if write is by_mcap_core else {}))
            expected = source.found() if source else {}
            said = {}
            for reader, read in {"rtstack": read_by_us, "mcap Python": read_by_python, "Rerun": read_by_rerun}.items():
                try:
                    said[reader] = compared(read(path), expected or read_by_python(path), checks=reader != "Rerun")
                except Exception as error:
                    said[reader] = "refused" if isinstance(error, LogError) else f"{type(error).__name__}: {error}"[:60]
            said["@mcap/core"] = read_by_mcap_core(path, node, expected or read_by_python(path))
            tally.update(f"{reader}: {what}" for reader, what in said.items())
            if said["rtstack"] != ("same" if merged else "refused"):
                wrong += 1
            count = sum(map(len, expected.values())) if expected else "-"
            row = " | ".join(said[each] for each in ("rtstack", "mcap Python", "@mcap/core", "Rerun"))
            print(f"| {name} | {count} | {row} |", flush=True)
            path.unlink()
    print("\n".join(f"{count:3} {what}" for what, count in sorted(tally.items())))
    return FAILED if wrong else 0


if __name__ == "__main__":
    program(main)
