"""Records to protobuf and back, whole batches at once, and their schema, made from the topic table without protoc.

A sample's bytes on the wire have a fixed layout: they are a structured dtype, and a batch is encoded by copying columns
into an array of it. What does not fit (names of errors, an enum value above 127) follows it: protobuf takes fields in
any order, and the last value of a field wins (https://protobuf.dev/programming-guides/encoding/). The field names are
the records'. t_ns is no field: MCAP's log_time carries it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from numpy.typing import NDArray

from hal.base.record import Field
from hal.topic import PACKAGE, Message
from rtstack.topics import MESSAGES

_Type = descriptor_pb2.FieldDescriptorProto


def _add_enum(file: descriptor_pb2.FileDescriptorProto, enum: type[IntEnum]) -> None:
    prefix = "".join("_" + c if c.isupper() and i else c for i, c in enumerate(enum.__name__)).upper()
    added = file.enum_type.add(name=enum.__name__)
    for member in enum:
        added.value.add(name=f"{prefix}_{member.name}", number=int(member))


def _add_field(message: descriptor_pb2.DescriptorProto, field: Field) -> None:
    added = message.field.add(name=field.name, number=len(message.field) + 1, label=_Type.LABEL_OPTIONAL)
    if field.bits:  # a bit mask in the record, the names of its bits on the wire
        added.label, added.type = _Type.LABEL_REPEATED, _Type.TYPE_STRING
    elif field.enum is not None:
        added.type, added.type_name = _Type.TYPE_ENUM, f".{PACKAGE}.{field.enum.__name__}"
    else:  # integers too have a fixed size: the encoder fills templates
        added.type = _Type.TYPE_SFIXED64 if field.kind == "i8" else _Type.TYPE_DOUBLE
        if field.dtype.shape:
            added.label = _Type.LABEL_REPEATED
            added.options.packed = True


def sample_file() -> descriptor_pb2.FileDescriptorProto:
    """Return the descriptor of rtstack/samples.proto, with every field's text and unit as its comment."""
    file = descriptor_pb2.FileDescriptorProto(name="rtstack/samples.proto", package=PACKAGE, syntax="proto3")
    fields = [field for message in MESSAGES.values() for field in message.fields]
    for enum in dict.fromkeys(field.enum for field in fields if field.enum is not None):
        _add_enum(file, enum)
    for message_index, message in enumerate(MESSAGES.values()):
        added = file.message_type.add(name=message.name)
        # path: field numbers of descriptor.proto, 4 = message_type of a file, 2 = field of a message
        _add_comment(file, [4, message_index], message.text)
        for number, field in enumerate(message.fields):
            _add_comment(file, [4, message_index, 2, number], field.comment)
            _add_field(added, field)
    return file


def _add_comment(file: descriptor_pb2.FileDescriptorProto, path: list[int], text: str) -> None:
    file.source_code_info.location.add(path=path, span=[0, 0, 0], leading_comments=f" {text}\n")


@cache
def sample_descriptors() -> bytes:
    """Return the serialised FileDescriptorSet of all our messages: the schema data of each of our topics."""
    return descriptor_pb2.FileDescriptorSet(file=[sample_file()]).SerializeToString(deterministic=True)


_VARINT, _I64, _LENGTH = 0, 1, 2  # wire types
_INT32 = np.iinfo(np.int32)


def varint(value: int) -> bytes:
    """Return `value` as protobuf's variable-length integer; a negative one takes ten bytes."""
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


@dataclass(frozen=True, slots=True)
class WireField:
    """A field on the wire. payload: "u1" an enum's one byte, "f8", "i8", or "" for names of bits; count: of a packed
    array, None for one. bits, column_major: see hal.base.record.Field."""

    name: str
    number: int
    payload: str
    count: int | None = None
    bits: tuple[str, ...] = ()
    column_major: bool = False

    @property
    def tag(self) -> bytes:
        """Its number and wire type."""
        array = self.count is not None or not self.payload
        return varint(self.number << 3 | (_VARINT if self.payload == "u1" else _LENGTH if array else _I64))


class WireFormat:
    """A message on the wire: `template` is the dtype of one without names of bits, `size` its bytes.

    record: what it is decoded into; fields: in the order of their bytes. Those that the record does not have are passed
    over; what only the record has is zero.
    """

    def __init__(self, record: np.dtype, fields: Sequence[WireField]) -> None:
        self.record = record
        parts: list[tuple[str, str, int | tuple[int, ...]]] = []
        constants, fixed = bytearray(), bytearray()
        for field in fields:
            if not field.payload:
                continue
            payload = np.dtype((field.payload, (field.count if field.count is not None else 1,)))
            prefix = field.tag if field.count is None else field.tag + varint(payload.itemsize)
            parts.append((f"{field.name} prefix", "u1", (len(prefix),)))
            parts.append((field.name, field.payload, payload.shape))
            constants += prefix + bytes(payload.itemsize)
            fixed += b"\1" * len(prefix) + bytes(payload.itemsize)
        self.template = np.dtype(parts)
        self.size = self.template.itemsize
        known = [field for field in fields if field.name in (record.names or ())]
        self._masks = [field for field in known if not field.payload]
        self._enums = [field for field in known if field.payload == "u1"]
        self._turned = [field for field in known if field.column_major]
        # fields whose bytes are on the wire as they are in the record: copied as such, not number by number
        others = {*self._masks, *self._enums, *self._turned}
        self._plain = [field.name for field in known if field not in others]
        self._empty = np.frombuffer(bytes(constants), self.template)
        self._wire_bytes, self._record_bytes = (_as_bytes(dtype, self._plain) for dtype in (self.template, self.record))
        self._fixed_bytes = np.flatnonzero(np.frombuffer(bytes(fixed), np.uint8))
        self._fixed_values = np.frombuffer(bytes(constants), np.uint8)[self._fixed_bytes]
        self._masks_of_tail: dict[bytes, dict[str, int]] = {}

    def encode(self, records: NDArray) -> list[bytes]:
        """Return one message for each record of `records`, shape (n,)."""
        wire = np.repeat(self._empty, len(records))
        tails: dict[int, bytes] = {}
        wire_bytes, record_bytes = wire.view(self._wire_bytes), records.view(self._record_bytes)
        for name in self._plain:
            wire_bytes[name] = record_bytes[name]
        for field in self._enums:
            values = records[field.name]
            wide = (values < 0) | (values > 0x7F)
            wire[field.name][:, 0] = np.where(wide, 0, values)
            for row in np.flatnonzero(wide).tolist():
                tails[row] = tails.get(row, b"") + field.tag + varint(int(np.clip(values[row], _INT32.min, _INT32.max)))
        for field in self._turned:
            wire[field.name] = records[field.name].transpose(0, 2, 1).reshape(wire[field.name].shape)
        for field in self._masks:
            masks = records[field.name]
            for row in np.flatnonzero(masks).tolist():
                names = [name.encode() for bit, name in enumerate(field.bits) if int(masks[row]) >> bit & 1]
                tails[row] = tails.get(row, b"") + b"".join(field.tag + varint(len(name)) + name for name in names)
        size, data = self.size, wire.tobytes()
        messages = [data[start : start + size] for start in range(0, len(data), size)]
        for row, tail in tails.items():
            messages[row] += tail
        return messages

    def decode(self, rows: NDArray[np.uint8]) -> tuple[NDArray, NDArray[np.bool_]]:
        """Return the records of `rows`, shape (n, size), t_ns left out, and which rows are of this format."""
        records = np.zeros(len(rows), self.record)
        mine = (rows[:, self._fixed_bytes] == self._fixed_values).all(axis=1)
        wire = np.ascontiguousarray(rows).view(self.template)[:, 0]
        for name in self._plain:
            records[name] = wire[name].reshape(records[name].shape)
        for field in self._enums:
            values = wire[field.name][:, 0]
            mine &= values <= 0x7F  # the first byte of a longer varint
            records[field.name] = values
        for field in self._turned:
            rows_of, columns_of = self.record[field.name].shape
            records[field.name] = wire[field.name].reshape(-1, columns_of, rows_of).transpose(0, 2, 1)
        return records, mine

    def decode_tail(self, tail: bytes) -> dict[str, int] | None:
        """Return the bit masks whose names follow a template, by field; None if something else follows it."""
        if tail not in self._masks_of_tail and (masks := self._parse_names(tail)) is not None:
            self._masks_of_tail[tail] = masks
        return self._masks_of_tail.get(tail)

    def _parse_names(self, tail: bytes) -> dict[str, int] | None:
        masks, position = {field.name: 0 for field in self._masks}, 0
        while position < len(tail):
            field = next((field for field in self._masks if tail.startswith(field.tag, position)), None)
            if field is None or position + len(field.tag) == len(tail):
                return None
            start = position + len(field.tag) + 1
            position = start + tail[start - 1]
            name = tail[start:position].decode("ascii", "replace")
            if name not in field.bits:
                return None
            masks[field.name] |= 1 << field.bits.index(name)
        return masks


def _as_bytes(dtype: np.dtype, names: list[str]) -> np.dtype:
    """Return a dtype of the same memory in which each of these fields is its bytes."""
    fields: Any = dtype.fields
    places = [(dtype[name].itemsize, fields[name][1]) for name in names]
    formats, offsets = [f"V{size}" for size, _ in places], [offset for _, offset in places]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})


@cache
def wire_format(message: str) -> WireFormat:
    """Return the format of one of the messages of rtstack.topics.MESSAGES, as we write it."""
    ours = MESSAGES[message]
    return WireFormat(ours.record, [_own_field(field, number) for number, field in enumerate(ours.fields, start=1)])


def _own_field(field: Field, number: int) -> WireField:
    if field.bits:
        return WireField(field.name, number, "", bits=field.bits)
    dtype = field.dtype
    count = int(np.prod(dtype.shape)) if dtype.shape else None
    payload = "u1" if field.enum is not None else dtype.base.str[1:]
    return WireField(field.name, number, payload, count, column_major=field.column_major)


def wire_format_of(message: Message, descriptor: Descriptor, counts: Mapping[str, int]) -> WireFormat | None:
    """Return the format of messages that another version wrote, by the descriptor in their file.

    counts: the lengths of their arrays, by field. None where a field has a form that we never wrote, or another than
    ours: such messages are for the protobuf library.
    """
    ours, fields = {field.name: field for field in message.fields}, []
    for described in sorted(descriptor.fields, key=lambda field: field.number):
        name, number = described.name, described.number
        own = _own_field(ours[name], number) if name in ours else None
        if own is not None and own.bits and described.type == FieldDescriptor.TYPE_STRING:
            fields.append(own)
            continue
        payload = _PAYLOADS.get(described.type, "")
        count = counts.get(name, 0) if described.is_repeated else None
        if not payload or (own is not None and (own.payload, own.count) != (payload, count)):
            return None
        fields.append(own or WireField(name, number, payload, count))
    return WireFormat(message.record, fields) if fields else None


_PAYLOADS = {FieldDescriptor.TYPE_ENUM: "u1", FieldDescriptor.TYPE_DOUBLE: "f8", FieldDescriptor.TYPE_SFIXED64: "i8"}
