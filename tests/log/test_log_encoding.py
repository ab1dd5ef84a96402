"""The fast encoder against the protobuf library, for any values."""

from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.records import Schema
from numpy.typing import NDArray

from hal.base.record import Field
from hal.robot_errors import error_names
from rtstack.log.file.decoding import TopicDecoder, message_class
from rtstack.log.writing.encoding import WireField, WireFormat, sample_descriptors, sample_file, varint, wire_format
from rtstack.topics import MESSAGES, TOPICS

TOPIC_OF = {topic.message.name: name for name, topic in TOPICS.items()}


def schema_of(message: str) -> Schema:
    return Schema(id=1, data=sample_descriptors(), encoding="protobuf", name=f"rtstack.{message}")


def records_of(message: str, enums: st.SearchStrategy[int]) -> st.SearchStrategy[NDArray[Any]]:
    """Batches of up to four records with any bit pattern of doubles, any counts and any set of errors."""
    whole = st.integers(-(1 << 63), (1 << 63) - 1)

    def values(field: Field) -> st.SearchStrategy[Any]:
        if field.enum is not None:
            return enums
        if field.bits:
            return st.one_of(st.just(0), st.integers(0, (1 << len(field.bits)) - 1))
        if field.kind == "i8":
            return whole
        return hnp.arrays(np.float64, field.dtype.shape) if field.dtype.shape else st.floats(width=64)

    def build(rows: list[tuple[Any, ...]]) -> NDArray[Any]:
        return np.array(rows, MESSAGES[message].record)

    fields = MESSAGES[message].fields
    return st.lists(st.tuples(whole, *(values(field) for field in fields)), max_size=4).map(build)


def places(encoded: list[bytes]) -> tuple[bytes, NDArray[np.int64], NDArray[np.int64]]:
    sizes = np.array([len(message) for message in encoded], np.int64)
    return b"".join(encoded), np.cumsum(sizes) - sizes, sizes


def same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Equal bit for bit: NaN is a value that a log has to keep."""
    return a.tobytes() == b.tobytes()


any_enum = st.one_of(st.integers(0, 6), st.sampled_from([127, 128, 300, -1, (1 << 31) - 1, -(1 << 31)]))


@pytest.mark.parametrize("message", list(MESSAGES))
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_the_protobuf_library_reads_every_field(message: str, data: st.DataObject) -> None:
    records = data.draw(records_of(message, any_enum))
    encoded = wire_format(message).encode(records)
    assert len(encoded) == len(records)
    for record, content in zip(records, encoded, strict=True):
        decoded = message_class(schema_of(message)).FromString(content)
        assert not decoded.DESCRIPTOR.is_extendable
        for name in MESSAGES[message].record.names or ():
            if name == "t_ns":
                assert name not in decoded.DESCRIPTOR.fields_by_name
            elif name == "current_errors":
                assert tuple(decoded.current_errors) == error_names(int(record[name]))
            elif name == "O_T_EE":
                column_major = np.array(decoded.O_T_EE).reshape((4, 4), order="F")
                assert same(column_major.copy(order="C"), record[name])
            else:
                value = np.array(getattr(decoded, name), MESSAGES[message].record[name].base)
                assert same(value, record[name])


@pytest.mark.parametrize("message", list(MESSAGES))
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_what_was_encoded_is_decoded(message: str, data: st.DataObject) -> None:
    records = data.draw(records_of(message, any_enum))
    content, start, size = places(wire_format(message).encode(records))
    decoder = TopicDecoder(TOPIC_OF[message], schema_of(message))
    assert same(decoder.decode(content, records["t_ns"], start, size), records)


@pytest.mark.parametrize("message", list(MESSAGES))
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_any_other_encoding_of_the_same_message_is_decoded(message: str, data: st.DataObject) -> None:
    records = data.draw(records_of(message, any_enum))
    parse = message_class(schema_of(message)).FromString
    encoded = [parse(content).SerializeToString() for content in wire_format(message).encode(records)]
    content, start, size = places(encoded)
    decoder = TopicDecoder(TOPIC_OF[message], schema_of(message))
    decoded = decoder.decode(content, records["t_ns"], start, size)
    for name in records.dtype.names or ():
        np.testing.assert_array_equal(decoded[name], records[name], err_msg=name)


@given(st.integers(-(1 << 63), (1 << 63) - 1))
def test_varint_is_protobufs(value: int) -> None:
    message = descriptor_pb2.UninterpretedOption(negative_int_value=value)
    assert message.SerializeToString()[1:] == varint(value)


def test_the_schema_stands_alone_and_explains_itself() -> None:
    files = descriptor_pb2.FileDescriptorSet.FromString(sample_descriptors()).file
    assert [file.name for file in files] == ["rtstack/samples.proto"]
    comments = {tuple(entry.path): entry.leading_comments for entry in files[0].source_code_info.location}
    control = next(i for i, message in enumerate(files[0].message_type) if message.name == "ControlSample")
    fields = [field.name for field in files[0].message_type[control].field]
    assert "qw qx qy qz" in comments[(4, control, 2, fields.index("pose_ref"))]
    assert all(comments[(4, i, 2, j)] for i, m in enumerate(files[0].message_type) for j in range(len(m.field)))
    values = {enum.name: enum.value[0].name for enum in files[0].enum_type}
    assert values == {
        "RobotMode": "ROBOT_MODE_OTHER",
        "Mode": "MODE_IDLE",
        "QpStatus": "QP_STATUS_NOT_USED",
        "Verdict": "VERDICT_NONE",
        "Reason": "REASON_NONE",
    }


def older(message: str) -> tuple[Schema, WireFormat]:
    """What a version wrote that numbered its fields in another way, knew fewer of ours, and had two of its own."""
    file = sample_file()
    described = next(one for one in file.message_type if one.name == message)
    del described.field[-1]
    for name, label in (("retired", 3), ("retired_too", 1)):
        described.field.add(name=name, number=1, label=label, type=1)  # a list of doubles, and a double
    described.field[-2].options.packed = True
    ours, own, fields = {field.name: field for field in MESSAGES[message].fields}, [], []
    retired = {"retired": Field("retired", "", axes=("1", "2", "3")), "retired_too": Field("retired_too", "")}
    for number, added in enumerate(described.field, start=11):
        added.number = number
        field = (ours | retired)[added.name]
        form = field.dtype
        own.append((field.name, form))
        if field.bits:
            fields.append(WireField(field.name, number, "", bits=field.bits))
            continue
        payload = "u1" if field.enum is not None else form.base.str[1:]
        count = int(np.prod(form.shape)) if form.shape else None
        fields.append(WireField(field.name, number, payload, count, column_major=field.column_major))
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)
    schema = Schema(id=1, data=data, encoding="protobuf", name=f"rtstack.{message}")
    return schema, WireFormat(np.dtype([("t_ns", "i8"), *own]), fields)


@pytest.mark.parametrize("message", list(MESSAGES))
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_another_versions_messages_are_decoded_at_once_by_the_schema_in_their_file(
    message: str, data: st.DataObject
) -> None:
    records = data.draw(records_of(message, st.integers(0, 127)))
    if not len(records):
        return
    schema, form = older(message)
    old = np.full(len(records), 7.5).astype(form.record)
    for name in (form.record.names or ())[:-2]:
        old[name] = records[name]
    content, start, size = places(form.encode(old))
    decoder, one_by_one = TopicDecoder(TOPIC_OF[message], schema), []
    decoder._fill_sample = lambda record, _: one_by_one.append(record)  # type: ignore[method-assign]
    decoded = decoder.decode(content, records["t_ns"], start, size)
    dropped = MESSAGES[message].fields[-1].name
    assert not decoded[dropped].any()
    expected = records.copy()
    expected[dropped] = 0
    assert same(decoded, expected)
    assert not one_by_one  # the first one tells how all of them lie


def test_a_schema_whose_fields_have_other_types_is_left_to_the_protobuf_library() -> None:
    file = sample_file()
    timing = next(one for one in file.message_type if one.name == "TimingSample")
    next(field for field in timing.field if field.name == "period_us").type = 2  # single precision
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    schema = Schema(id=1, data=data, encoding="protobuf", name="rtstack.TimingSample")
    encoded = [message_class(schema)(period_us=1.5, missed_deadlines=k).SerializeToString() for k in range(3)]
    content, start, size = places(encoded)
    decoded = TopicDecoder("/timing", schema).decode(content, np.arange(3), start, size)
    assert decoded["period_us"].tolist() == [1.5] * 3
    assert decoded["missed_deadlines"].tolist() == [0, 1, 2]
