"""The rings: nothing torn, everything lost is counted, nobody waits."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rtstack.log.errors import LogError
from rtstack.log.ring import LogState, Rings
from rtstack.samples import ARM_SAMPLE, TIMING_SAMPLE
from rtstack.topics import TOPICS

# a reader in another process: every record that it gets is whole, and each one is either read or counted as lost
READER = """
import sys
import numpy as np
from rtstack.log.ring import Rings
rings = Rings.attach(sys.argv[1])
reader = rings.log_reader("/left/arm")
print("attached", flush=True)
read, last, torn, disordered = 0, 0, 0, 0
closing = False
while True:
    closing = rings.closing
    records = reader.drain()
    read += len(records)
    number = records["t_ns"]
    torn += int((records["tau_applied"] != number[:, None]).any() or (records["q"] != number[:, None]).any())
    disordered += int(len(number) > 0 and (number[0] <= last or (np.diff(number) <= 0).any()))
    last = int(number[-1]) if len(number) else last
    if closing:
        break
print(read, reader.lost, last, torn, disordered)
"""


def timing(t_ns: int) -> np.ndarray:
    record = np.zeros(1, TIMING_SAMPLE)
    record["t_ns"] = t_ns
    return record


def test_a_reader_gets_what_is_pushed_after_it_was_made() -> None:
    with Rings.create(capacity=16) as rings:
        pusher = rings.pusher("/timing")
        pusher.push(timing(1))
        reader = rings.reader("/timing")
        assert len(reader.drain()) == 0
        for t in (2, 3):
            pusher.push(timing(t))
        assert reader.drain()["t_ns"].tolist() == [2, 3]
        assert len(reader.drain()) == 0
        assert reader.lost == 0


def test_a_slow_reader_keeps_the_newest_and_counts_the_rest() -> None:
    with Rings.create(capacity=16) as rings:
        pusher, reader = rings.pusher("/timing"), rings.reader("/timing")
        for t in range(50):
            pusher.push(timing(t))
        assert reader.drain()["t_ns"].tolist() == list(range(34, 50))
        assert reader.lost == 34


def test_latest_is_the_newest_and_moves_nothing() -> None:
    with Rings.create(capacity=16) as rings:
        pusher, reader = rings.pusher("/timing"), rings.reader("/timing")
        assert reader.latest() is None
        for t in range(20):
            pusher.push(timing(t))
        newest = reader.latest()
        assert newest is not None
        assert newest["t_ns"].tolist() == [19]
        assert len(reader.drain()) == 16


def test_every_topic_has_a_ring_of_its_own() -> None:
    with Rings.create(capacity=8, capacities={"/events": 2}) as rings:
        for index, (name, topic) in enumerate(TOPICS.items()):
            record = np.zeros(1, topic.record)
            record["t_ns"] = index
            rings.pusher(name).push(record)
        for index, topic in enumerate(TOPICS):
            assert rings.log_reader(topic).drain()["t_ns"].tolist() == [index]
        assert rings.room() == 2


def test_room_is_what_the_log_process_has_not_read() -> None:
    with Rings.create(capacity=16) as rings:
        pusher, reader = rings.pusher("/timing"), rings.log_reader("/timing")
        for t in range(10):
            pusher.push(timing(t))
        assert rings.room() == 6
        for t in range(10):
            pusher.push(timing(t))
        assert rings.room() == 0
        reader.drain()
        assert rings.room() == 16
        assert rings.lost("/timing") == 4


def test_nobody_waits_for_a_log_process_that_failed() -> None:
    with Rings.create(capacity=16) as rings:
        pusher = rings.pusher("/timing")
        for t in range(20):
            pusher.push(timing(t))
        rings.fail("No space left on device")
        assert rings.state is LogState.FAILED
        assert rings.error == "No space left on device"
        assert rings.room() == 16


def test_a_record_of_another_topic_is_refused() -> None:
    with Rings.create(capacity=16) as rings, pytest.raises(TypeError, match="dtype"):
        rings.pusher("/timing").push(np.zeros(1, ARM_SAMPLE))


@pytest.mark.parametrize("capacity", [0, 1, 3, 1000])
def test_a_capacity_is_a_power_of_two(capacity: int) -> None:
    with pytest.raises(ValueError, match="power of two"):
        Rings.create(capacity=capacity)


def test_a_missing_block_is_a_clear_error() -> None:
    with pytest.raises(LogError, match="no rings named"):
        Rings.attach("rtstack-none")


def test_the_end_of_an_attached_process_leaves_the_block_alone() -> None:
    with Rings.create(capacity=16) as rings:
        code = f"from rtstack.log.ring import Rings; Rings.attach({rings.name!r}).reader('/timing').drain()"
        subprocess.run([sys.executable, "-c", code], check=True)
        assert Rings.attach(rings.name).room() == 16
    assert not Path("/dev/shm", rings.name).exists()


def test_two_processes_tear_nothing_and_count_every_loss() -> None:
    count = 200_000
    with Rings.create(capacity=16) as rings:  # small: the writer laps the reader all the time
        pusher = rings.pusher("/left/arm")
        record = np.zeros(1, ARM_SAMPLE)
        reader = subprocess.Popen([sys.executable, "-c", READER, rings.name], stdout=subprocess.PIPE, text=True)
        with reader:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "attached\n"
            for number in range(1, count + 1):
                record["t_ns"] = number
                record["q"] = number
                record["tau_applied"] = number
                pusher.push(record)
            rings.request_close()
            read, lost, last, torn, disordered = (int(word) for word in reader.stdout.readline().split())
    assert (torn, disordered) == (0, 0)
    assert read + lost == count
    assert last == count
    assert read > 16  # it did read while the writer wrote
