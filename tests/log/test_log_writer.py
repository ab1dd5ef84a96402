"""The log process, started for real: what goes in comes out, and every way to end it leaves a file to read."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foxglove.channel import _channels_by_id
from mcap.reader import make_reader

from rtstack.log.errors import LogError
from rtstack.log.file.recover import recover
from rtstack.log.reader import read_log
from rtstack.log.ring import CAPACITY, LogState, Rings
from rtstack.log.viewers.scenery import scenery_schemas
from rtstack.log.writer import Attachment, LogProcess, check_log_path
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.topics import TICK_TOPICS, TOPICS
from tests.support.log.samples import CELL, MS, RESULT, TRIAL, WrittenLog, push_all, random_records

# a trial that is killed: pushes for ever, at ten times the robot's pace, and says what it has pushed
TRIAL_PROGRAM = """
import sys, time
import numpy as np
from rtstack.log.ring import Rings
from rtstack.log.writer import Attachment, LogProcess
from rtstack.topics import TICK_TOPICS, TOPICS
rings = Rings.create()
log = LogProcess.start(sys.argv[1], rings, {"trial": {"seed": "7"}})
log.wait_ready()
pushers = {t: rings.pusher(t) for t in TOPICS if t != "/events"}
records = {t: np.zeros(1, TOPICS[t].record) for t in pushers}
records["/object/pose"]["seen"] = 1
tick = 0
while True:
    log.wait_room(128)
    for _ in range(10):
        tick += 1
        for topic, pusher in pushers.items():
            records[topic]["t_ns"] = tick * 1_000_000
            pusher.push(records[topic])
    print(log.pid, tick, flush=True)
    time.sleep(0.001)
"""


def eventually(condition: Callable[[], bool], timeout_s: float = 20.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def state_of(pid: int) -> str:
    """Return the state letter of proc(5), nothing for a process that is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return ""


def is_running(pid: int) -> bool:
    return state_of(pid) not in ("", "Z")


def push_and_close(rings: Rings, columns: dict[str, np.ndarray], log: LogProcess) -> None:
    push_all(rings, columns, log)
    log.close()


def test_every_record_of_every_topic_comes_back(written: WrittenLog) -> None:
    log = read_log(written.path)
    for topic, records in written.columns.items():
        back = log.topic(topic)
        assert back.dtype == records.dtype
        for name in records.dtype.names or ():
            np.testing.assert_array_equal(back[name], records[name], err_msg=f"{topic} {name}")
    assert written.summary.lost == 0
    made = sum(len(log.messages(topic)) for topic in scenery_schemas())
    assert written.summary.messages == sum(len(r) for r in written.columns.values()) + made


def test_metadata_attachments_and_events_come_back(written: WrittenLog) -> None:
    log = read_log(written.path)
    assert log.metadata["trial"] == TRIAL
    assert log.metadata["result"] == RESULT
    assert log.metadata["log"]["ended"] == "closed"
    assert log.metadata["log"]["lost"] == "0"
    assert [(a.name, a.media_type, a.data) for a in log.attachments] == [("cell.toml", "application/toml", CELL)]
    assert [event.text for event in log.events] == [f"event {i}" for i in range(5)]
    assert log.duration_s == pytest.approx(1.499)


def test_the_file_is_in_order_of_the_robots_time(written: WrittenLog) -> None:
    with open(written.path, "rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]
        file.seek(0)
        summary = make_reader(file).get_summary()
    assert times == sorted(times)
    assert summary is not None
    # a chunk never holds more than the quarter of a second that a killed writer may lose
    assert all(c.message_end_time - c.message_start_time <= 250 * MS for c in summary.chunk_indexes)


def test_the_caller_goes_on_while_the_process_starts(tmp_path: Path) -> None:
    with Rings.create() as rings:
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": TRIAL})
        assert rings.state is LogState.STARTING  # importing takes the child far longer than returning takes us
        records = random_records("/timing", 10)
        pusher = rings.pusher("/timing")
        for row in range(10):
            pusher.push(records[row : row + 1])
        log.wait_ready()
        assert log.close().messages == 10
        assert rings.state is LogState.FINISHED


def test_losses_are_counted_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Rings.create(capacities={"/timing": 16}) as rings:
        log = LogProcess.start(path, rings, {"trial": TRIAL})
        log.wait_ready()
        os.kill(log.pid, signal.SIGSTOP)  # the slowest log process that there is
        assert eventually(lambda: state_of(log.pid) == "T")
        push = rings.pusher("/timing").push
        record = random_records("/timing", 1)
        for _ in range(100):
            push(record)
        os.kill(log.pid, signal.SIGCONT)
        summary = log.close()
    account = read_log(path).metadata["log"]
    assert summary.lost >= 84
    assert summary.lost + summary.messages == 100
    assert account["lost"] == str(summary.lost)
    assert f'"/timing": {{"messages": {summary.messages}, "lost": {summary.lost}}}' in account["topics"]


def test_an_interrupt_is_the_parents_business(tmp_path: Path) -> None:
    with Rings.create() as rings:
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": TRIAL})
        log.wait_ready()
        assert os.getsid(log.pid) != os.getsid(0)  # a Ctrl-C in our terminal does not even reach it
        os.kill(log.pid, signal.SIGINT)
        push_all(rings, {"/left/arm": random_records("/left/arm", 10)}, log)
        assert log.close().messages == 10


def test_a_killed_log_process_costs_nothing_that_the_rings_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    columns = {topic: random_records(topic, 4000) for topic in TOPICS if topic != "/events"}
    with Rings.create() as rings:
        log = LogProcess.start(path, rings, {"trial": TRIAL}, [Attachment("cell.toml", "application/toml", CELL)])
        log.wait_ready()
        # as at the robot's pace, the process reads and never lags by more than 48 ms: all in the robot's time, so
        # that it does not matter how fast this machine is
        push_all(rings, {topic: records[:3000] for topic, records in columns.items()}, log, room=CAPACITY - 32)
        os.kill(log.pid, signal.SIGKILL)
        assert eventually(lambda: not is_running(log.pid))
        with pytest.raises(LogError, match=r"rtstack recover .*a.mcap`.*killed by signal 9"):
            log.check()
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(path.read_bytes())
        for topic, records in columns.items():  # the stop, which no log process reads
            pusher, record = rings.pusher(topic), records[:1].copy()
            for k in range(3000, 4000):
                record[:] = records[k]
                pusher.push(record)
        summary = log.close(RESULT)
    assert 2500 * MS <= recover(cut).last_t_ns < 3000 * MS  # what the program's own death leaves
    log_read = read_log(path)
    assert (log_read.metadata["trial"], log_read.metadata["result"]) == (TRIAL, RESULT)
    assert log_read.metadata["log"]["ended"] == "its process was killed by signal 9"
    assert summary.messages == int(log_read.metadata["log"]["messages"]) == sum(map(log_read.count, log_read.topics))
    assert [a.name for a in log_read.attachments] == ["cell.toml"]
    for topic, records in columns.items():
        back = log_read.topic(topic)
        for name in records.dtype.names or ():
            np.testing.assert_array_equal(back[name], records[name], err_msg=f"{topic} {name}")
    with open(path, "rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.mcap", "cut.mcap", "cut.recovered.mcap"]


def test_a_killed_log_has_what_the_rings_hold_and_says_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    columns = {topic: random_records(topic, 4000) for topic in TICK_TOPICS}
    with Rings.create(capacity=1024) as rings:
        log = LogProcess.start(path, rings, {"trial": TRIAL})
        log.wait_ready()
        push_all(rings, {topic: records[:1000] for topic, records in columns.items()}, log, room=992)
        os.kill(log.pid, signal.SIGKILL)
        assert eventually(lambda: not is_running(log.pid))
        for topic, records in columns.items():
            pusher, record = rings.pusher(topic), records[:1].copy()
            for k in range(1000, 4000):
                record[:] = records[k]
                pusher.push(record)
        with pytest.raises(LogError, match=r"lacks 2\.\d+ s: its process was killed by signal 9"):
            log.close(RESULT)
    back = read_log(path)
    assert (back.topic("/left/arm")["t_ns"][-1024:] == columns["/left/arm"]["t_ns"][-1024:]).all()
    assert back.metadata["result"]["success"] == "false"


def test_a_log_whose_folder_is_moved_or_removed_is_not_lost(tmp_path: Path) -> None:
    columns = {"/left/arm": random_records("/left/arm", 100)}
    for k, change in enumerate((lambda old, new: old.rename(new), lambda old, new: shutil.rmtree(old))):
        folder, moved = tmp_path / f"logs{k}", tmp_path / f"moved{k}"
        folder.mkdir()
        with Rings.create() as rings:
            log = LogProcess.start(folder / "a.mcap", rings, {"trial": TRIAL})
            push_all(rings, columns, log)
            change(folder, moved)
            if k:
                log.close(RESULT)
            else:
                with pytest.raises(LogError, match=f"not at {folder}/a.mcap any more.*it is at {moved}/a.mcap"):
                    log.close(RESULT)
        assert len(read_log((folder if k else moved) / "a.mcap").topic("/left/arm")) == 100


def test_a_log_that_cannot_begin_leaves_no_file(tmp_path: Path) -> None:
    with Rings.create() as rings:
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": TRIAL})
        os.kill(log.pid, signal.SIGKILL)
        with pytest.raises(LogError, match=r"cannot be written: its process was killed"):
            log.wait_ready()
        log.abandon()
    assert not list(tmp_path.iterdir())


def test_the_log_is_finished_when_the_program_dies(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    program = subprocess.Popen([sys.executable, "-c", TRIAL_PROGRAM, str(path)], stdout=subprocess.PIPE, text=True)
    with program:
        assert program.stdout is not None
        pid, ticks = 0, 0
        while ticks < 500:
            pid, ticks = (int(word) for word in program.stdout.readline().split())
        program.kill()
    assert eventually(lambda: not is_running(pid))
    log = read_log(path)
    assert log.metadata["trial"] == {"seed": "7"}
    assert log.metadata["log"]["ended"] == "the program died"
    assert "result" not in log.metadata
    arm = log.topic("/left/arm")["t_ns"]
    assert len(arm) >= 500
    np.testing.assert_array_equal(arm, np.arange(1, len(arm) + 1) * MS)


def test_a_full_disk_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Rings.create() as rings:
        log = LogProcess.start(path, rings, {"trial": TRIAL})
        log.wait_ready()
        # the child's own limit on file sizes: the kernel refuses the write as it does on a full disk
        resource.prlimit(log.pid, resource.RLIMIT_FSIZE, (400_000, 400_000))
        columns = {topic: random_records(topic, 2000) for topic in ("/left/arm", "/right/arm")}
        with pytest.raises(LogError, match="incomplete: File too large"):
            push_and_close(rings, columns, log)
        assert rings.state is LogState.FAILED
        log.abandon()
    assert recover(path).messages > 0


@pytest.fixture
def small_disk(tmp_path: Path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if mounted.returncode:
        assert "CI" not in os.environ, "CI has the privileges to mount a small disk"
        pytest.skip("mounting needs privileges")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_small_disk_fills_up(small_disk: Path) -> None:
    with Rings.create() as rings:
        log = LogProcess.start(small_disk / "a.mcap", rings, {"trial": TRIAL})
        columns = {topic: random_records(topic, 2000) for topic in ("/left/arm", "/right/arm")}
        with pytest.raises(LogError, match="incomplete: No space left on device"):
            push_and_close(rings, columns, log)
        log.abandon()
    assert recover(small_disk / "a.mcap", small_disk.parent / "b.mcap").messages > 0


def test_paths_that_cannot_be_written_are_refused_before_anything_starts(tmp_path: Path) -> None:
    existing = tmp_path / "old.mcap"
    existing.write_bytes(b"precious")
    for path, message in (
        (tmp_path / "none" / "a.mcap", "directory .*none does not exist"),
        (tmp_path, "is a directory"),
        (existing, "exists already"),
        (Path("/dev/full"), "not a regular file"),
        (existing / "a.mcap", "does not exist"),
    ):
        with pytest.raises(LogError, match=message):
            check_log_path(path)
    check_log_path(tmp_path / "new.mcap")
    check_log_path(existing, overwrite=True)
    assert existing.read_bytes() == b"precious"
    assert not (tmp_path / "new.mcap").exists()


def test_a_directory_that_takes_no_files_is_refused() -> None:
    # /proc takes no files even from a superuser, who may write to any directory's mode
    with Rings.create(capacity=16) as rings, pytest.raises(LogError, match=r"cannot write /proc/self/a\.mcap"):
        LogProcess.start(Path("/proc/self/a.mcap"), rings, {})


def test_a_run_that_ended_before_its_first_tick_still_has_its_events(tmp_path: Path) -> None:
    with Rings.create() as rings:
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": TRIAL})
        push_all(rings, {"/events": random_records("/events", 1)}, log)
        log.close()
    assert [event.text for event in read_log(tmp_path / "a.mcap").events] == ["event 0"]


def test_an_object_that_was_never_seen_is_not_in_the_log(tmp_path: Path) -> None:
    poses = random_records("/object/pose", 10)
    poses["seen"][:4] = 0
    with Rings.create() as rings:
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": TRIAL})
        push_all(rings, {"/object/pose": poses}, log)
        assert log.close().messages == 6
    np.testing.assert_array_equal(read_log(tmp_path / "a.mcap").topic("/object/pose"), poses[4:])


def test_an_existing_log_is_only_replaced_on_request(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with Rings.create(capacity=16) as rings:
        with pytest.raises(LogError, match="exists already"):
            LogProcess.start(path, rings, {})
        assert path.read_bytes() == b"precious"
        log = LogProcess.start(path, rings, {"trial": TRIAL}, overwrite=True)
        log.close(RESULT)
    empty = read_log(path)
    assert empty.metadata["result"] == RESULT
    assert len(empty.topic("/left/arm")) == 0
    assert empty.events == ()


def test_a_process_that_writes_many_logs_keeps_none_of_their_channels(tmp_path: Path) -> None:
    before = len(_channels_by_id)
    with open(tmp_path / "one.mcap", "wb") as file:
        McapWriter(file).close()
    assert len(_channels_by_id) == before
