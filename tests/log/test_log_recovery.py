"""Recovery from any cut: everything up to the last complete record, and the original stays as it is."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, Writer

from rtstack.log.errors import LogError
from rtstack.log.file.container import RECORD_HEADER, is_complete, sections
from rtstack.log.file.recover import recover
from rtstack.log.reader import read_log
from rtstack.log.viewers.scenery import scenery_schemas
from rtstack.topics import TOPICS
from tests.support.log.samples import TICKS, TRIAL, WrittenLog
from tests.support.sampling import sampled

RERUN = Path(sys.executable).with_name("rerun")


def cut_of(written: WrittenLog, directory: Path, size: int) -> Path:
    path = directory / "cut.mcap"
    path.write_bytes(written.path.read_bytes()[:size])
    return path


@pytest.mark.parametrize("share", sampled((0.15, 0.3333, 0.5, 0.77, 0.9, 0.999), lambda share: share in (0.5, 0.999)))
def test_a_cut_log_is_recovered_to_the_last_record(tmp_path: Path, written: WrittenLog, share: float) -> None:
    size = int(written.path.stat().st_size * share)
    path = cut_of(written, tmp_path, size)
    seen: list[tuple[int, int]] = []
    summary = recover(path, progress=lambda done, total: seen.append((done, total)))
    assert path.stat().st_size == size
    assert seen
    assert all(done <= total == size for done, total in seen)
    assert summary.output is not None
    log, partly = read_log(summary.output), read_log(path, truncated=True)
    assert (log.complete, partly.complete) == (True, False)
    assert log.metadata["trial"] == TRIAL
    assert log.metadata["recovery"]["source"] == "cut.mcap"
    assert [a.name for a in log.attachments] == [a.name for a in partly.attachments] == ["cell.toml"]
    total = sum(len(log.messages(topic)) for topic in scenery_schemas())
    for topic, records in written.columns.items():
        back = log.topic(topic)
        total += len(back)
        np.testing.assert_array_equal(back, records[: len(back)], err_msg=topic)
        np.testing.assert_array_equal(back, partly.topic(topic), err_msg=topic)
    assert summary.messages == total
    assert summary.last_t_ns == max(int(log.topic(topic)["t_ns"].max(initial=0)) for topic in TOPICS)
    # what is recovered is what was there: the share of the file, but for one block of a compressed chunk
    assert len(log.topic("/left/arm")) >= (share - 0.06) * TICKS


def test_other_readers_accept_a_recovered_log(tmp_path: Path, written: WrittenLog) -> None:
    summary = recover(cut_of(written, tmp_path, written.path.stat().st_size // 2), tmp_path / "out.mcap")
    assert summary.output == tmp_path / "out.mcap"
    with open(tmp_path / "out.mcap", "rb") as file:
        indexed = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
        file.seek(0)
        streamed = sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages())
        file.seek(0)
        statistics = make_reader(file).get_summary()
    assert statistics is not None
    assert statistics.statistics is not None
    assert indexed == streamed == summary.messages == statistics.statistics.message_count
    if RERUN.exists():
        environment = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}
        command = [RERUN, "mcap", "check", "--full", summary.output]
        checked = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert checked.returncode == 0, checked.stderr


def test_a_complete_log_is_left_alone(tmp_path: Path, written: WrittenLog) -> None:
    summary = recover(written.path, tmp_path / "out.mcap")
    assert summary.complete
    assert summary.output is None
    assert not (tmp_path / "out.mcap").exists()


def test_an_earlier_recovery_is_not_overwritten(tmp_path: Path, written: WrittenLog) -> None:
    path = cut_of(written, tmp_path, written.path.stat().st_size // 2)
    recover(path)
    with pytest.raises(LogError, match=r"cut\.recovered\.mcap exists already"):
        recover(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.mcap", "cut.recovered.mcap"]


def test_a_log_that_is_cut_behind_an_attached_recording_is_not_complete(tmp_path: Path, written: WrittenLog) -> None:
    path, recording = tmp_path / "cut.mcap", written.path.read_bytes()
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_attachment(0, 0, "reference.mcap", "application/octet-stream", recording)
        writer.finish()
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(recording) + len(recording)])
    with open(path, "rb") as file:
        assert not is_complete(file)
    path.write_bytes(whole)
    with open(path, "rb") as file:
        assert is_complete(file)


@pytest.mark.parametrize("size", [8, 9, 40])
def test_a_log_of_which_nothing_is_left_is_a_clear_error(tmp_path: Path, written: WrittenLog, size: int) -> None:
    path = cut_of(written, tmp_path, size)
    with pytest.raises(LogError, match="nothing to recover"):
        recover(path)
    assert [p.name for p in tmp_path.iterdir()] == ["cut.mcap"]


def _nothing_left(path: Path, left: str) -> None:
    """Write a log that is cut before its first chunk, or whose only chunk cannot be read."""
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        writer.add_metadata("trial", TRIAL)
        writer.add_attachment(0, 0, "cell.toml", "text/plain", b"name = 'grab'")
        end = file.tell()
        channel = writer.register_channel("/a", "json", writer.register_schema("x", "jsonschema", b"{}"))
        for t in range(100):
            writer.add_message(channel, t, bytes(100), t)
        writer.finish()
    whole = bytearray(path.read_bytes())
    if left == "a damaged chunk":
        frame = whole.index(b"\x04\x22\x4d\x18")  # LZ4's
        whole[frame : frame + 4] = bytes(4)
    path.write_bytes(whole[: end if left == "no chunk" else -20])


@pytest.mark.parametrize(("left", "said"), [("no chunk", "message;"), ("a damaged chunk", "1 chunks that cannot")])
def test_a_recovery_without_a_message_fails_and_writes_nothing(tmp_path: Path, left: str, said: str) -> None:
    path = tmp_path / "cut.mcap"
    _nothing_left(path, left)
    command = [sys.executable, "-m", "rtstack", "recover", path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1, done.stderr
    assert f"{path} holds nothing to recover" in done.stderr
    assert said in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["cut.mcap"]


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
@pytest.mark.parametrize("chunked", [True, False])
def test_any_writers_cut_file_is_recovered(tmp_path: Path, compression: str, chunked: bool) -> None:
    path = tmp_path / "other.mcap"
    rng = np.random.default_rng(1)
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=100_000, compression=CompressionType[compression], use_chunking=chunked)
        writer.start()
        channel = writer.register_channel("/a", "json", writer.register_schema("x", "jsonschema", b"{}"))
        for t in range(1000):
            writer.add_message(channel, t, rng.bytes(1000), t)
        writer.finish()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    summary = recover(path, tmp_path / "out.mcap")
    assert summary.messages > 350  # half of them, but for one chunk and one block
    with open(tmp_path / "out.mcap", "rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages()]
    assert times == list(range(summary.messages))


def test_a_record_that_is_broken_inside_is_left_out_and_counted(tmp_path: Path, written: WrittenLog) -> None:
    path = cut_of(written, tmp_path, written.path.stat().st_size - 40)
    with open(path, "r+b") as file:
        broken = next(record for record in sections(file) if record.opcode == Opcode.METADATA)
        file.seek(broken.offset + RECORD_HEADER + 4)
        file.write(b"\xff")  # the first letter of its name: no UTF-8
    summary = recover(path)
    assert len(summary.missing) == 1
    assert summary.output is not None
    assert read_log(summary.output).metadata["recovery"]["damaged_chunks"] == "1"


@pytest.mark.parametrize(("place", "value"), [(2, b"\x0f\0\0\0"), (14, b"\xff\xff\xff\xff"), (14, b"\x01\0\0\0")])
def test_a_log_whose_message_index_is_broken_is_read_without_it(
    tmp_path: Path, written: WrittenLog, place: int, value: bytes
) -> None:
    """An array whose length is none of pairs; a place beyond the chunk; one between two messages."""
    path = cut_of(written, tmp_path, written.path.stat().st_size)
    with open(path, "r+b") as file:
        for record in [record for record in sections(file) if record.opcode == Opcode.MESSAGE_INDEX]:
            file.seek(record.offset + RECORD_HEADER + place)
            file.write(value)
    np.testing.assert_array_equal(read_log(path).topic("/left/arm"), written.columns["/left/arm"])
