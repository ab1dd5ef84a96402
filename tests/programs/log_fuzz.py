"""Changes small logs in their structure, and looks whether each is read whole or refused in one line.

`python -m tests.programs.log_fuzz --count 1000000 --processes 2`: what is made depends on --seed alone.
`--flip N --log LOG` flips N bits of a finished log, one at a time, and recovers it: only the chunk
that was hit may lose messages.

Takes two hours for a million logs, or 1 second a flip.
"""

import multiprocessing
import random
import signal
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

from rtstack.log.errors import LogError
from rtstack.log.file.container import open_mcap
from rtstack.log.file.recover import recover
from rtstack.log.reader import read_log
from rtstack.topics import ARM_TOPICS, TOPICS
from tests.programs import FAILED, program
from tests.support.log.mutations import MUTATIONS, Times, contradicted, messages_of, mutated, options, small_log

HANGS_S = 10
BATCH = 500
RECOVERED = 20  # one in so many is recovered too
KINDS = ("read whole", "read whole, damaged elsewhere", "refused", "wrong")
KEPT = 20  # files of failures that are kept


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the pool ends its processes by it


def _hangs(_number: int, _frame: FrameType | None) -> None:
    raise TimeoutError


def times_of(path: Path) -> Times:
    """Return the log times of the arms' samples as the reader gives them. Raises LogError."""
    log = read_log(path)
    return {topic: times for topic in ARM_TOPICS if (times := log.topic(topic)["t_ns"].tolist())}


def checked(path: Path, data: bytes, before: Times, recovers: bool) -> str:
    """Return what came of reading these bytes, "wrong: ..." where that was not right."""
    path.write_bytes(data)
    found = messages_of(data)
    whole = None if found is None else {topic: found[topic] for topic in ARM_TOPICS if topic in found}
    signal.alarm(HANGS_S)
    try:
        if recovers:
            out = path.with_name("out.mcap")
            out.unlink(missing_ok=True)
            try:
                summary = recover(path, out)
                least = sum(map(len, (messages_of(data, streamed=True) or {}).values()))
                if not summary.complete and summary.messages < least:
                    return f"wrong: {summary.messages} of {least} recovered"
                if summary.complete and found is None:
                    return "wrong: called complete"
                if not summary.complete and not recover(out).complete:
                    return "wrong: recovered to what is not complete"
            except LogError as error:
                if "\n" in str(error):
                    return "wrong: several lines"
        times = times_of(path)
    except LogError as error:
        return "refused" if "\n" not in str(error) and str(error) else "wrong: several lines"
    except TimeoutError:
        return "wrong: hangs"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"wrong: {type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    if whole is not None and times == whole:
        return "read whole"
    if whole is None and (found := messages_of(data, defined=True)) is not None:
        whole = {topic: found[topic] for topic in ARM_TOPICS if topic in found}
        if times == whole:
            return "read whole, damaged elsewhere"
    if times == before and (found is None or contradicted(data)):
        return "read whole, damaged elsewhere"
    return f"wrong: {[len(each) for each in times.values()]} for {whole and [len(each) for each in whole.values()]}"


def _batch(work: tuple[int, int, int, str]) -> Counter[str]:
    """Check logs from a number on."""
    seed, first, count, keep = work
    signal.signal(signal.SIGALRM, _hangs)
    found: Counter[str] = Counter()
    with TemporaryDirectory(dir="/dev/shm") as folder:
        rng = random.Random(f"{seed} {first}")
        logs = [small_log(rng, **options(rng)) for _ in range(4)]
        times = [messages_of(data) or {} for data in logs]
        for number in range(first, first + count):
            rng = random.Random(f"{seed} {number}")
            k = rng.randrange(len(logs))
            names, data = mutated(rng, logs[k], logs)
            before = {topic: times[k][topic] for topic in ARM_TOPICS if topic in times[k]}
            said = checked(Path(folder) / "log.mcap", data, before, number % RECOVERED == 0)
            found[said.split(":")[0]] += 1
            if said.startswith("wrong"):
                found[f"{number} {names}: {said}"] += 1
                if keep:
                    (Path(keep) / f"{number}.mcap").write_bytes(data)
            for name in names.split("+"):
                found[f"  {name}: {said.split(':')[0]}"] += 1
    return found


def flips(path: Path, count: int, seed: int) -> int:
    """Flip bits of a finished log; print a table, return how many messages were lost where none was hit."""
    log, data, rng = read_log(path), bytearray(path.read_bytes()), random.Random(seed)
    total = sum(len(log.messages(topic)) for topic in log.topics)
    spans = [(part.section.offset, part.section.end, part) for part in log._contents.parts]
    table: Counter[tuple[str, ...]] = Counter()
    worst = 0
    with TemporaryDirectory() as folder:
        flipped, out = Path(folder) / "flipped.mcap", Path(folder) / "out.mcap"
        for number in range(count):
            bit = rng.randrange(8 * len(data))
            data[bit // 8] ^= 1 << (bit % 8)
            flipped.write_bytes(data)
            data[bit // 8] ^= 1 << (bit % 8)
            out.unlink(missing_ok=True)
            hit = next((part for begin, end, part in spans if begin <= bit // 8 < end), None)
            try:
                read = read_log(flipped)
                for topic in TOPICS:
                    read.topic(topic)
                said = "read"
            except LogError:
                said = "refused"
            summary = recover(flipped, out)
            lost = 0 if summary.complete else total - summary.messages
            inside = 0
            if hit is not None:
                with open_mcap(path) as file:
                    inside = len(log._contents.messages(file, hit)[1])
            worst = max(worst, lost - inside)
            table["in a chunk" if hit else "elsewhere", said, "complete" if summary.complete else "recovered",
                  "all" if not lost else "all but the chunk" if lost <= inside else f"lost {lost}",
                  "named" if summary.missing else ""] += 1  # fmt: skip
            if number % 100 == 99:
                print(f"{number + 1} bits", flush=True)
    for row, times in sorted(table.items()):
        print(f"{times:6} " + " | ".join(row))
    print(f"messages lost outside of the chunk that was hit: {worst}")
    return worst


def main(
    count: int = 1_000_000, seed: int = 0, processes: int = 1, keep: str = "", flip: int = 0, log: Path | None = None
) -> int:
    """Print a table. keep: folder for what is wrong. Returns 0, or 1 where a log was read wrongly, or crashed."""
    if flip and log:
        return FAILED if flips(log, flip, seed) else 0
    if keep:
        Path(keep).mkdir(parents=True, exist_ok=True)
    found, began, done = Counter[str](), time.monotonic(), 0
    signal.signal(signal.SIGALRM, signal.SIG_IGN)  # what is compiled now is there in each process
    with TemporaryDirectory() as folder:
        data = small_log(random.Random(0))
        checked(Path(folder) / "log.mcap", data[: len(data) // 2] + data[len(data) // 2 + 9 :], {}, True)
    work = ((seed, first, min(BATCH, count - first), keep) for first in range(0, count, BATCH))
    with multiprocessing.get_context("fork").Pool(processes, _begin) as pool:
        try:
            for part in pool.imap_unordered(_batch, work):
                found += part
                done += BATCH
                if done % (20 * BATCH) == 0:
                    print(f"{done} logs, {time.monotonic() - began:.0f} s, wrong: {found['wrong']}", flush=True)
        except KeyboardInterrupt:
            pool.terminate()
            print(f"interrupted after {done} logs")
    for name in KINDS:
        print(f"{name:32} {found[name]:9}")
    for name in MUTATIONS:
        row = [
            found[f"  {name}: {kind}"] for kind in ("read whole", "read whole, damaged elsewhere", "refused", "wrong")
        ]
        print(f"  {name:30} " + " ".join(f"{each:9}" for each in row))
    for line in [each for each in found if each[0].isdigit()][:KEPT]:
        print(line)
    print(f"{sum(found[name] for name in KINDS)} logs, "
          f"seed {seed}, {time.monotonic() - began:.0f} s")  # fmt: skip
    return FAILED if found["wrong"] else 0


if __name__ == "__main__":
    program(main)
