"""Throws mutated files and messages at everything that reads what others wrote, guided by the coverage of the readers.

    pip install atheris==3.0.0
    python -m tests.programs.fuzz_inputs [TARGET...] [--runs 200000] [--seconds 120] [--out DIR]

Each target is a process of its own. A reader may refuse, by the error that it documents, and nothing else: any other
exception is a defect, kept with its input in OUT/TARGET. Prints how many inputs, defects, and the largest memory.
The simulated robot's server is `fuzz`, the console's interface `make fuzz-api`.
"""

import argparse
import contextlib
import json
import os
import resource
import shutil
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import atheris

TARGETS = ("mcap", "recover", "reference", "cell", "faults", "acceptance", "dataset", "natnet", "tracker", "request")
UNGUIDED = ("reference", "tracker")
READERS = ["mcap", "tomllib", "rtstack.log", "rtstack.datasets", "rtstack.model.cell_description"]
READERS += ["rtstack.references.acceptance", "rtstack.live.protocol"]
READERS += ["hal.natnet", "hal.configuration", "sim_robot.faults"]
MEMORY_MB = 2048  # beyond it the process is ended by libFuzzer


@dataclass(frozen=True, slots=True)
class Target:
    """What reads an input, which exceptions are its documented refusals, and what a mutation begins with."""

    read: Callable[[bytes], object]
    refusals: tuple[type[Exception], ...]
    seeds: tuple[bytes, ...]
    longest: int = 1 << 16


def _small_log(compression: str) -> bytes:
    """The first messages of each topic of a demonstration, as mcap's own writer writes them."""
    from io import BytesIO

    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    path = Path("demonstration.mcap")
    if not path.exists():
        subprocess.run([sys.executable, "-m", "rtstack", "teach", str(path)], check=True, stdout=subprocess.DEVNULL)
    out, schemas, channels, counts = BytesIO(), {}, {}, {}
    writer = Writer(out, chunk_size=4096, compression=CompressionType[compression])
    writer.start(profile="", library="")
    with open(path, "rb") as file:
        reader = make_reader(file)
        for entry in reader.iter_metadata():
            writer.add_metadata(entry.name, entry.metadata)
        for schema, channel, message in reader.iter_messages():
            if channel.id not in channels:
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                own = channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                channels[channel.id] = writer.register_channel(*own)
            counts[channel.id] = counts.get(channel.id, 0) + 1
            if counts[channel.id] <= 3 and len(message.data) < 4096:
                writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
    writer.finish()
    return out.getvalue()


def _in_a_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    path = Path(name)

    def run(data: bytes) -> object:
        path.write_bytes(data)
        return read(path)

    return run


def _mcap() -> Target:
    from rtstack.log.errors import LogError
    from rtstack.log.reader import read_log
    from rtstack.topics import TOPICS

    def read(path: Path) -> None:
        log = read_log(path)
        for name in TOPICS:
            with contextlib.suppress(LogError):
                log.topic(name)
        _ = log.events, log.duration_s

    seeds = tuple(_small_log(each) for each in ("NONE", "LZ4", "ZSTD"))
    return Target(_in_a_file("x.mcap", read), (LogError,), seeds, 1 << 18)


def _recover() -> Target:
    from rtstack.log.errors import LogError
    from rtstack.log.recover import recover

    def read(path: Path) -> None:
        with contextlib.suppress(FileNotFoundError):
            path.with_suffix(".recovered.mcap").unlink()
        recover(path)

    log = _small_log("LZ4")
    return Target(_in_a_file("x.mcap", read), (LogError,), (log, log[: len(log) // 2], log[:-40]), 1 << 18)


def _reference() -> Target:
    from rtstack.cells import load_description
    from rtstack.log.errors import LogError
    from rtstack.references.acceptance import Acceptance
    from rtstack.references.recording import ReferenceError as NoReference
    from rtstack.trials.errors import TrialError
    from rtstack.trials.extraction import extract

    description, _ = load_description(None)
    seeds = tuple(_small_log(each) for each in ("NONE", "LZ4"))
    read = _in_a_file("x.mcap", lambda path: extract(path, description, Acceptance()))
    return Target(read, (LogError, TrialError, NoReference), seeds, 1 << 18)


def _cell() -> Target:
    from hal.configuration import ConfigurationError
    from rtstack.cells import default_cell_file
    from rtstack.model.cell_description import load_cell_description

    return Target(
        _in_a_file("x.toml", load_cell_description), (ConfigurationError,), (default_cell_file().read_bytes(),)
    )  # fmt: skip


def _faults() -> Target:
    from hal.configuration import ConfigurationError
    from sim_robot.faults.file import load_faults

    seed = b'[[fault]]\nkind = "state_nan"\nside = "left"\nat_s = 1.0\n[[fault]]\nkind = "fci_off"\nat_s = 0.5\n'
    return Target(_in_a_file("x.toml", load_faults), (ConfigurationError,), (seed,))


def _acceptance() -> Target:
    from rtstack.references.acceptance import Acceptance, AcceptanceError, load_acceptance, save_acceptance

    recording = Path("x.mcap")
    save_acceptance(recording, Acceptance())
    (seed,) = (path for path in Path().glob("x.mcap.*.json"))
    return Target(_in_a_file(seed.name, lambda _: load_acceptance(recording)), (AcceptanceError,), (seed.read_bytes(),))


def _dataset() -> Target:
    from rtstack.datasets.lerobot_import import import_episode
    from rtstack.log.errors import LogError

    whole = Path("whole")
    if not whole.exists():
        _small_log("NONE")
        command = [sys.executable, "-m", "rtstack", "export", "demonstration.mcap", str(whole), "--to", "lerobot"]
        subprocess.run([*command, "--fps", "1"], check=True, stdout=subprocess.DEVNULL)
    names = [str(path.relative_to(whole)) for path in sorted(whole.rglob("*")) if path.is_file()]
    names = [name for name in names if "stats" not in name and "tasks" not in name]
    scratch = Path("set")
    shutil.copytree(whole, scratch, dirs_exist_ok=True)

    def read(data: bytes) -> None:
        """The first byte says which file of the data set the rest is."""
        name = names[data[0] % len(names)] if data else names[0]
        (scratch / name).write_bytes(data[1:])
        try:
            import_episode(scratch, 0, Path("imported.mcap"))
        finally:
            shutil.copy(whole / name, scratch / name)

    seeds = tuple(bytes((k,)) + (whole / name).read_bytes() for k, name in enumerate(names))
    return Target(read, (LogError,), seeds, 1 << 18)


def _natnet() -> Target:
    import struct

    from hal.natnet import NatNetError, frame_of, version_in

    body = struct.pack("<i3f4ffh", 7, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0, 0.0, 1)
    old = struct.pack("<HHi", 7, 0, 1) + struct.pack("<iii", 0, 0, 1) + body + bytes(16) + bytes(8)
    new = struct.pack("<HHi", 7, 0, 1) + bytes(16) + struct.pack("<ii", 1, len(body)) + body + bytes(64)

    def read(data: bytes) -> None:
        for version in ((3, 1), (4, 0), (4, 1)):
            with contextlib.suppress(NatNetError):
                frame_of(data, version)
        version_in(data)

    return Target(read, (NatNetError,), (old, new, bytes(4 + 256 + 8)), 4096)


def _tracker() -> Target:
    import numpy as np

    from hal.tracker_link import DATAGRAM, TrackerLink

    link = TrackerLink()
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def read(data: bytes) -> None:
        sender.sendto(data, link.address)
        record = link.latest().record[0]
        assert not record["seen"] or np.isfinite(record["position"]).all()

    good = np.zeros(1, DATAGRAM)
    good["orientation_wxyz"], good["seen"] = (1.0, 0.0, 0.0, 0.0), 1
    return Target(read, (), (good.tobytes(), bytes(3)), 256)


def _request() -> Target:
    from rtstack.live.protocol import ProtocolError, TrialRequest, decode_answer, decode_request, encode

    def read(data: bytes) -> None:
        with contextlib.suppress(ProtocolError):
            decode_answer(data)
        decode_request(data)

    seeds = (encode(TrialRequest(reference="x.mcap", operator="me")), b'{"verb":"status"}')
    return Target(read, (ProtocolError,), seeds, 8192)


def _one(name: str, runs: int, seconds: int, out: Path) -> None:
    """Fuzz one target in this process, which then ends. Writes OUT/TARGET/outcome.json each second or so."""
    folder = (out / name).resolve()
    corpus, work = folder / "corpus", Path(f"/dev/shm/rtstack-fuzz-{os.getpid()}")
    corpus.mkdir(parents=True, exist_ok=True)
    work.mkdir()
    os.chdir(work)
    # what is compiled by numba cannot be instrumented: those targets mutate what the guided ones have found
    guided = nullcontext() if name in UNGUIDED else atheris.instrument_imports(include=READERS)
    with guided:
        target = globals()[f"_{name}"]()
    if name == "reference":
        shutil.copytree(corpus.parents[1] / "mcap" / "corpus", corpus, dirs_exist_ok=True)
    for number, seed in enumerate(target.seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    found: dict[str, int] = {}
    outcome = {"inputs": 0, "refused": 0, "defects": found, "memory_mb": 0.0, "slowest_s": 0.0, "seconds": 0.0}
    began = time.monotonic()

    def throw(data: bytes) -> None:
        start = time.monotonic()
        try:
            target.read(data)
        except target.refusals:
            outcome["refused"] += 1
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            key = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}"
            if key not in found:
                (folder / f"defect{len(found)}").write_bytes(data)
                (folder / f"defect{len(found)}.txt").write_text("".join(traceback.format_exception(error)))
            found[key] = found.get(key, 0) + 1
        now = time.monotonic()
        outcome["inputs"] += 1
        if now - start > outcome["slowest_s"]:
            outcome["slowest_s"] = round(now - start, 3)
        if outcome["inputs"] % 100 == 0 or outcome["inputs"] >= runs or now - began > seconds:
            outcome["memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1)
            outcome["seconds"] = round(now - began, 1)
            (folder / "outcome.json").write_text(json.dumps(outcome))

    options = [f"-runs={runs}", f"-max_total_time={seconds}", f"-max_len={target.longest}", "-timeout=60", "-seed=1",
               f"-rss_limit_mb={MEMORY_MB}", f"-artifact_prefix={folder}/", "-verbosity=0", str(corpus)]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], throw)
    atheris.Fuzz()


def main() -> int:
    """Run the targets one after the other, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--runs", type=int, default=200_000, help="inputs, at most, of each")
    parser.add_argument("--seconds", type=int, default=120, help="of each, at most")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--alone", choices=TARGETS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        _one(options.alone, options.runs, options.seconds, options.out)
    asked = ["--runs", str(options.runs), "--seconds", str(options.seconds), "--out", str(options.out)]
    print("| what | inputs | refused | defects | memory, MB | slowest, s | s |\n|---|---:|---:|---:|---:|---:|---:|")
    bad = 0
    for name in options.targets or TARGETS:
        (options.out / name).mkdir(parents=True, exist_ok=True)
        with open(options.out / name / "said.txt", "w") as said:
            command = [sys.executable, "-m", "tests.programs.fuzz_inputs", "--alone", name, *asked]
            process = subprocess.Popen(command, stdout=said, stderr=said)
            ended = process.wait()
        shutil.rmtree(f"/dev/shm/rtstack-fuzz-{process.pid}", ignore_errors=True)
        file = options.out / name / "outcome.json"
        if not file.exists():
            print(f"| {name} | ended with {ended}: {options.out / name / 'said.txt'} | | | | | |")
            bad += 1
            continue
        o = json.loads(file.read_text())
        print(f"| {name} | {o['inputs']} | {o['refused']} | {len(o['defects'])} | {o['memory_mb']:.0f} | "
              f"{o['slowest_s']:.2f} | {o['seconds']:.0f} |", flush=True)  # fmt: skip
        bad += len(o["defects"]) + (ended != 0)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
