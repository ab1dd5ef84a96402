"""Any legal MCAP is read whole or refused in one line; no file makes the reader wait, or fill the memory."""

import os
import random
import socket
import subprocess
import sys
from io import BytesIO
from pathlib import Path

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Statistics
from mcap.writer import CompressionType, IndexType, Writer

from rtstack.figures.log_data import figure_log
from rtstack.log.analysis.signals import DEFAULT, signals
from rtstack.log.errors import LogError
from rtstack.log.file.recover import recover
from rtstack.log.reader import read_log
from rtstack.log_folder.catalogue import entry_of
from rtstack.topics import ARM_TOPICS
from tests.support.log.mutations import MAGIC, end_fitted, messages_of, mutated, options, small_log, split, whole

VARIANTS = {
    "no message index": {"index_types": IndexType.CHUNK | IndexType.METADATA | IndexType.ATTACHMENT},
    "no index": {"index_types": IndexType.NONE}, "no channels": {"repeat_channels": False},
    "no schemas": {"repeat_schemas": False}, "no statistics": {"use_statistics": False},
    "no chunks": {"use_chunking": False}, "tiny chunks": {"chunk_size": 1},
    "no summary": {
        "index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False, "use_statistics": False,
        "use_summary_offsets": False,
    },
}  # fmt: skip


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_log_is_read_whole_whatever_its_writer_left_out(
    tmp_path: Path, variant: str, compression: CompressionType
) -> None:
    path = tmp_path / "log.mcap"
    for seed in range(4):  # with foreign times, and two channels of a topic
        data = small_log(random.Random(seed), compression=compression, **VARIANTS[variant])
        path.write_bytes(data)
        log, there = read_log(path), messages_of(data)
        assert there is not None
        for topic in ARM_TOPICS:
            assert log.topic(topic)["t_ns"].tolist() == there[topic]
            assert log.count(topic) == len(there[topic])
        assert log.metadata["result"] == {"success": "true"}
        assert log.attachment("cell.toml") == b"name = 'grab'\n"
        assert log.start_ns == 1_000_000  # whatever the foreign topic's times
        assert log.duration_s == pytest.approx((there["/left/arm"][-1] - 1_000_000) * 1e-9)
        assert recover(path).complete


def test_a_changed_log_is_read_whole_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for seed in range(150):
        rng = random.Random(seed)
        before = small_log(rng, **options(rng))
        path.write_bytes(mutated(rng, before, [before])[1])
        found = messages_of(path.read_bytes())
        found = messages_of(before) if found is None else found
        assert found is not None
        times, said = {}, ""
        try:
            log = read_log(path)
            times = {topic: log.topic(topic)["t_ns"].tolist() for topic in ARM_TOPICS}
        except LogError as error:
            said = str(error)
        assert "\n" not in said
        assert said or times == {topic: found.get(topic, []) for topic in ARM_TOPICS}, seed


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "folder.mcap").mkdir()
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket.mcap"))
        for name in ("pipe.mcap", "folder.mcap", "socket.mcap", "/dev/zero"):
            for read in (read_log, recover):
                with pytest.raises(LogError, match="it is not a regular file"):
                    read(tmp_path / name)
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(LogError, match=r"empty\.mcap is empty: nothing to recover"):
        read_log(tmp_path / "empty.mcap")
    with pytest.raises(LogError, match=r"a\\udcffb\.mcap: No such file"):
        read_log(tmp_path / os.fsdecode(b"a\xffb.mcap"))


def test_a_schema_with_other_types_is_refused_in_one_line(tmp_path: Path) -> None:
    data = small_log(random.Random(0), compression=CompressionType.NONE, enable_crcs=False)
    assert b"\x0a\x01q\x18\x01\x20\x03" in data  # q, 1, repeated
    (tmp_path / "log.mcap").write_bytes(data.replace(b"\x0a\x01q\x18\x01\x20\x03", b"\x0a\x01q\x18\x01\x20\x01"))
    with pytest.raises(LogError, match="a message of /left/arm is broken"):
        read_log(tmp_path / "log.mcap").topic("/left/arm")


def test_an_attachment_counts_once_however_often_it_is_named(tmp_path: Path) -> None:
    records = split(small_log(random.Random(0))[len(MAGIC) : -len(MAGIC)])
    (k,) = [k for k, (opcode, _) in enumerate(records) if opcode == Opcode.ATTACHMENT_INDEX]
    records[k:k] = [records[k]] * 5000
    index = AttachmentIndex.read(ReadDataStream(BytesIO(records[k][1])))
    path = tmp_path / "log.mcap"
    path.write_bytes(whole(end_fitted(records)))
    assert [each.name for each in read_log(path).attachments] == [index.name]
    (k,) = [k for k, (opcode, _) in enumerate(records) if opcode == Opcode.STATISTICS]
    assert Statistics.read(ReadDataStream(BytesIO(records[k][1]))).attachment_count == 1


def test_every_flipped_bit_of_a_log_is_recovered(tmp_path: Path) -> None:
    data = bytearray(
        small_log(random.Random(3), compression=CompressionType.NONE, chunk_size=500, enable_data_crcs=True)
    )
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    total = sum(map(len, (messages_of(bytes(data)) or {}).values()))
    worst = 0
    for bit in range(0, 8 * len(data), 149):
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        data[bit // 8] ^= 1 << bit % 8
        out.unlink(missing_ok=True)
        summary = recover(path, out)
        assert not summary.complete
        assert bool(summary.missing) >= (summary.messages < total)
        worst = max(worst, total - summary.messages)
        read_log(out)
    assert worst <= 8  # of the chunk that was hit


def test_a_table_of_a_topic_needs_pandas_or_says_so(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(small_log(random.Random(0)))
    code = (
        "import sys, types\n"
        "class Frame(dict):\n"
        "    def __init__(self, columns, index): super().__init__(columns); self.index, self.attrs = index, {}\n"
        "sys.modules['pandas'] = types.SimpleNamespace(DataFrame=Frame, Index=lambda values, name: values)\n"
        "from rtstack.log.reader import read_log\n"
        f"frame = read_log({str(path)!r}).frame('/left/arm')\n"
        "assert list(frame)[0] == 't_ns' and frame.index[0] == 0, list(frame)\n"
        "assert 'q.7' in frame and 'O_T_EE.r11' in frame and 'O_T_EE.z' in frame, list(frame)\n"
        f"assert not len(read_log({str(path)!r}).frame('/object/pose').index)\n"
        "assert frame.attrs['units']['tau_J.1'] == 'Nm' and frame.attrs['units']['O_T_EE.z'] == 'm'\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "pandas", None)
        with pytest.raises(LogError, match="pip install pandas"):
            read_log(path).frame("/left/arm")


def test_a_log_without_a_sample_is_listed_and_has_no_curve_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"none\xff.mcap")
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("trial", {"kind": "trial"})
        writer.finish()
    assert entry_of(path).kind == "trial"
    log = figure_log(path, [signals()[name] for name in DEFAULT])
    assert log.name == "none\ufffd"
    assert all(len(trace.t_s) == len(trace.values) == 0 for trace in log.traces)
    path.write_bytes(path.read_bytes()[:-9])
    assert read_log(path, truncated=True).metadata["trial"] == {"kind": "trial"}


def test_a_chunk_whose_length_is_wrong_is_recovered_without_an_index(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    for compression in CompressionType:
        data = small_log(random.Random(0), compression=compression, index_types=IndexType.NONE, chunk_size=500)
        there = messages_of(data)
        records = split(data[len(MAGIC) : -len(MAGIC)])
        k = [opcode for opcode, _ in records].index(Opcode.CHUNK)
        name = int.from_bytes(records[k][1][28:32], "little")
        for bit in (0, 5, 47):
            body = bytearray(records[k][1])
            body[32 + name + bit // 8] ^= 1 << bit % 8
            path.write_bytes(whole(end_fitted([*records[:k], (Opcode.CHUNK, bytes(body)), *records[k + 1 :]])))
            out.unlink(missing_ok=True)
            summary = recover(path, out)  # a decoder may not need the last byte
            assert not summary.missing
            log = read_log(summary.output or path)
            assert {topic: log.times(topic) for topic in log.topics} == there


def test_a_record_that_the_summary_places_beyond_every_file_is_looked_for(tmp_path: Path) -> None:
    data = small_log(random.Random(0), chunk_size=500)
    records = split(data[len(MAGIC) : -len(MAGIC)])
    k = [opcode for opcode, _ in records].index(Opcode.CHUNK_INDEX)
    body = records[k][1]
    records[k] = Opcode.CHUNK_INDEX, body[:16] + (1 << 63).to_bytes(8, "little") + body[24:]
    path = tmp_path / "log.mcap"
    path.write_bytes(whole(end_fitted(records)))
    with pytest.raises(LogError, match="the summary names a record here, and there is none"):
        read_log(path)
    summary = recover(path)
    assert summary.output is not None
    assert messages_of(summary.output.read_bytes()) == messages_of(data)


def test_a_summary_without_checksum_is_not_believed(tmp_path: Path) -> None:
    data = small_log(random.Random(0), enable_crcs=False, repeat_channels=True, chunk_size=500)
    place = data.rindex(b"/right/arm")
    path = tmp_path / "log.mcap"
    path.write_bytes(data[:place] + b"/wrong" + data[place + 6 :])
    log = read_log(path)
    assert {topic: log.times(topic) for topic in log.topics} == messages_of(data)
