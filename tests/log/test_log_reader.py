"""The log for everybody else's readers, and what our reader says about everybody else's files."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from hal.robot_errors import error_names
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.viewers.scenery import scenery_schemas
from rtstack.log.viewers.voxels import VOXELS
from rtstack.log.writing.encoding import sample_descriptors
from rtstack.topics import TOPICS
from tests.support.log.samples import MS, WrittenLog

RERUN = Path(sys.executable).with_name("rerun")


def test_a_generic_reader_decodes_every_field_of_every_topic(written: WrittenLog) -> None:
    seen = dict.fromkeys([*TOPICS, *scenery_schemas()], 0)
    with open(written.path, "rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            row = seen[channel.topic]
            seen[channel.topic] += 1
            if channel.topic not in TOPICS:
                continue
            record = written.columns[channel.topic][row]
            assert message.log_time == record["t_ns"]
            if channel.topic == "/events":
                assert (decoded.level, decoded.name) == (record["level"], "mode")
                assert decoded.message == f"event {row}"
            elif channel.topic == "/object/pose":
                assert decoded.frame_id == "world"
                assert decoded.timestamp.seconds * 1000 * MS + decoded.timestamp.nanos == record["t_ns"]
                p, q = decoded.pose.position, decoded.pose.orientation
                assert [p.x, p.y, p.z] == record["position"].tolist()
                assert [q.w, q.x, q.y, q.z] == record["orientation_wxyz"].tolist()
            else:
                for name in (record.dtype.names or ())[1:]:
                    value = getattr(decoded, name)
                    if name == "current_errors":
                        assert tuple(value) == error_names(int(record[name]))
                    elif name == "O_T_EE":
                        assert list(value) == record[name].T.ravel().tolist()
                    elif record.dtype[name].shape:
                        assert list(value) == record[name].tolist()
                    else:
                        assert value == record[name]
    assert [seen.pop(topic) for topic in ("/tf", "/scene", "/forces", "/forces/lines")] == [76, 2, 76, 76]
    assert {seen.pop(topic) for topic in VOXELS} == {1}
    assert seen == {topic: len(records) for topic, records in written.columns.items()}


@pytest.mark.parametrize("arguments", [["check", "--full"], ["info"]])
def test_another_projects_validator_accepts_the_log(written: WrittenLog, arguments: list[str], tmp_path: Path) -> None:
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}
    checked = subprocess.run(
        [RERUN, "mcap", *arguments, written.path], capture_output=True, text=True, env=environment, check=False
    )
    assert checked.returncode == 0, checked.stderr
    for topic in [*TOPICS, *scenery_schemas()]:
        line = next(line for line in checked.stdout.splitlines() if f" {topic} " in line)
        assert arguments == ["info"] or line.startswith("ok")


def test_what_is_no_log_of_ours_is_named(tmp_path: Path, written: WrittenLog) -> None:
    text = tmp_path / "notes.mcap"
    text.write_text("not at all")
    with pytest.raises(LogError, match=r"notes\.mcap is not an MCAP file"):
        read_log(text)
    with pytest.raises(LogError, match="No such file"):
        read_log(tmp_path / "none.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(written.path.read_bytes()[:-50])
    with pytest.raises(LogError, match=rf"cut off \(no summary\): recover it with `rtstack recover {cut}`"):
        read_log(cut)
    foreign = tmp_path / "foreign.mcap"
    with open(foreign, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(LogError, match="not a log of ours: topic /left/arm or /right/arm is missing"):
        read_log(foreign)
    with pytest.raises(LogError, match="/chatter is not a topic"):
        read_log(written.path).topic("/chatter")


def test_a_damaged_chunk_is_named_and_not_guessed_at(tmp_path: Path, written: WrittenLog) -> None:
    content = bytearray(written.path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content)
    log = read_log(damaged)
    with pytest.raises(LogError, match=r"damaged\.mcap is damaged at byte"):
        log.topic("/left/arm")


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_another_writers_file_is_read_alike(tmp_path: Path, written: WrittenLog, compression: str) -> None:
    from mcap.writer import CompressionType

    copy = tmp_path / "copy.mcap"
    with open(written.path, "rb") as source, open(copy, "wb") as target:
        writer = Writer(target, compression=CompressionType[compression], use_chunking=compression != "NONE")
        writer.start()
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "protobuf", schema_id)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.log_time)
        writer.finish()
    log = read_log(copy)
    assert log.duration_s == read_log(written.path).duration_s
    for topic, records in written.columns.items():
        np.testing.assert_array_equal(log.topic(topic), records, err_msg=topic)


def test_a_log_of_another_version_is_read_by_field_names(tmp_path: Path) -> None:
    from google.protobuf import descriptor_pb2
    from mcap.records import Schema

    from rtstack.log.file.decoding import message_class

    files = descriptor_pb2.FileDescriptorSet.FromString(sample_descriptors())
    fields = next(m for m in files.file[0].message_type if m.name == "ArmSample").field
    for field in fields:
        field.number += 20  # an older program that numbered its fields in another way, and knew no dq
    del fields[[field.name for field in fields].index("dq")]
    data = files.SerializeToString()
    old = message_class(Schema(id=1, data=data, encoding="protobuf", name="rtstack.ArmSample"))
    path = tmp_path / "old.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("rtstack.ArmSample", "protobuf", data)
        channel = writer.register_channel("/left/arm", "protobuf", schema)
        content = old(q=range(7), robot_mode=2, current_errors=["joint_reflex"]).SerializeToString()
        writer.add_message(channel, 5 * MS, content, 5 * MS)
        writer.finish()
    record = read_log(path).topic("/left/arm")[0]
    assert record["q"].tolist() == list(range(7))
    assert (record["t_ns"], record["robot_mode"], record["current_errors"]) == (5 * MS, 2, 1 << 6)
    assert not record["dq"].any()
