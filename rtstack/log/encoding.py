"""Records to protobuf and back, whole batches at once.

A sample has a fixed layout, and so have its bytes on the wire: tags and lengths never change, doubles are 8
bytes. The bytes of a message are therefore a structured dtype, and a batch is encoded by copying columns into
an array of it. What does not fit the template (names of errors, an enum value above 127) follows it: protobuf
takes fields in any order, and the last value of a field wins.
https://protobuf.dev/programming-guides/encoding/
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from numpy.typing import NDArray

from hal.robot_errors import ROBOT_ERRORS, error_names
from rtstack.log.schema import COLUMN_MAJOR_FIELD, ENUM_FIELDS, ERRORS_FIELD, MESSAGES

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
    """A field on the wire. payload: "u1" an enum's one byte, "f8" or "i8"; count: of a packed array, None for one."""

    name: str
    number: int
    payload: str
    count: int | None = None


class WireFormat:
    """A message on the wire: `template` is the dtype of one without errors, `size` its bytes.

    record: what it is decoded into; fields in the order of their bytes, the names of errors among them with payload "".
    Fields that the record does not have are passed over, and of what only the record has nothing is known: zeros.
    """

    def __init__(self, record: np.dtype, fields: Sequence[WireField]) -> None:
        self.record = record
        self.tags: dict[str, bytes] = {}
        parts: list[tuple[str, str, int | tuple[int, ...]]] = []
        constants = bytearray()
        for field in fields:
            name, array = field.name, field.count is not None
            wire_type = _VARINT if field.payload == "u1" else _LENGTH if array or name == ERRORS_FIELD else _I64
            self.tags[name] = tag = varint(field.number << 3 | wire_type)
            if name == ERRORS_FIELD:
                continue
            payload = np.dtype((field.payload, (field.count if field.count is not None else 1,)))
            prefix = tag + varint(payload.itemsize) if array else tag
            parts.append((f"{name} prefix", "u1", (len(prefix),)))
            parts.append((name, field.payload, payload.shape))
            constants += prefix + bytes(payload.itemsize)
        self.template = np.dtype(parts)
        self.size = self.template.itemsize
        known = record.names or ()
        self.names = [field.name for field in fields if field.name != ERRORS_FIELD and field.name in known]
        self._empty = np.frombuffer(bytes(constants), self.template)
        # fields whose bytes are on the wire as they are in the record: copied as such, not number by number
        self._plain = [name for name in self.names if name not in ENUM_FIELDS and name != COLUMN_MAJOR_FIELD]
        self._wire_bytes, self._record_bytes = (_as_bytes(dtype, self._plain) for dtype in (self.template, self.record))
        fixed = np.zeros(1, self.template)
        for field in fields:
            if field.name != ERRORS_FIELD:
                fixed[f"{field.name} prefix"] = 0xFF
        self._fixed_bytes = np.flatnonzero(fixed.view(np.uint8))
        self._fixed_values = np.frombuffer(bytes(constants), np.uint8)[self._fixed_bytes]
        self._errors_of_tail: dict[bytes, int] = {}

    def encode(self, records: NDArray) -> list[bytes]:
        """Return one message for each record of `records`, shape (n,)."""
        wire = np.repeat(self._empty, len(records))
        tails: dict[int, bytes] = {}
        wire_bytes, record_bytes = wire.view(self._wire_bytes), records.view(self._record_bytes)
        for name in self._plain:
            wire_bytes[name] = record_bytes[name]
        for name in self.names:
            if name in ENUM_FIELDS:
                values = records[name]
                wide = (values < 0) | (values > 0x7F)
                wire[name][:, 0] = np.where(wide, 0, values)
                for row in np.flatnonzero(wide).tolist():
                    value = int(np.clip(values[row], _INT32.min, _INT32.max))
                    tails[row] = tails.get(row, b"") + self.tags[name] + varint(value)
            elif name == COLUMN_MAJOR_FIELD:
                wire[name] = records[name].transpose(0, 2, 1).reshape(wire[name].shape)
        if ERRORS_FIELD in self.tags:
            errors = records[ERRORS_FIELD]
            for row in np.flatnonzero(errors).tolist():
                tails[row] = tails.get(row, b"") + self._errors_tail(int(errors[row]))
        size, data = self.size, wire.tobytes()
        messages = [data[start : start + size] for start in range(0, len(data), size)]
        for row, tail in tails.items():
            messages[row] += tail
        return messages

    def _errors_tail(self, mask: int) -> bytes:
        tag = self.tags[ERRORS_FIELD]
        return b"".join(tag + varint(len(name)) + name.encode() for name in error_names(mask))

    def decode(self, rows: NDArray[np.uint8]) -> tuple[NDArray, NDArray[np.bool_]]:
        """Return the records of `rows`, shape (n, size), t_ns left out, and which rows are of this format."""
        records = np.zeros(len(rows), self.record)
        mine = (rows[:, self._fixed_bytes] == self._fixed_values).all(axis=1)
        wire = np.ascontiguousarray(rows).view(self.template)[:, 0]
        for name in self.names:
            values = wire[name]
            if name in ENUM_FIELDS:
                mine &= values[:, 0] <= 0x7F  # the first byte of a longer varint
                records[name] = values[:, 0]
            elif name == COLUMN_MAJOR_FIELD:
                records[name] = values.reshape(-1, 4, 4).transpose(0, 2, 1)
            else:
                records[name] = values.reshape(records[name].shape)
        return records, mine

    def decode_tail(self, tail: bytes) -> int | None:
        """Return the errors that follow a template as a bit mask, None if something else follows it."""
        if tail not in self._errors_of_tail:
            mask = self._parse_errors(tail)
            if mask is None:
                return None
            self._errors_of_tail[tail] = mask
        return self._errors_of_tail[tail]

    def _parse_errors(self, tail: bytes) -> int | None:
        tag, mask, position = self.tags.get(ERRORS_FIELD), 0, 0
        while position < len(tail):
            if tag is None or not tail.startswith(tag, position) or position + len(tag) == len(tail):
                return None
            start = position + len(tag) + 1
            position = start + tail[start - 1]
            name = tail[start:position].decode("ascii", "replace")
            if name not in ROBOT_ERRORS:
                return None
            mask |= 1 << ROBOT_ERRORS.index(name)
        return mask


def _as_bytes(dtype: np.dtype, names: list[str]) -> np.dtype:
    """Return a dtype of the same memory in which each of these fields is its bytes."""
    fields: Any = dtype.fields
    places = [(dtype[name].itemsize, fields[name][1]) for name in names]
    formats, offsets = [f"V{size}" for size, _ in places], [offset for _, offset in places]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})


@cache
def wire_format(message: str) -> WireFormat:
    """Return the format of one of the messages of rtstack.log.schema.MESSAGES, as we write it."""
    record = MESSAGES[message]
    names = [name for name in record.names or () if name != "t_ns"]
    return WireFormat(record, [_own_field(record, name, number) for number, name in enumerate(names, start=1)])


def _own_field(record: np.dtype, name: str, number: int) -> WireField:
    dtype = record[name]
    if name == ERRORS_FIELD:
        return WireField(name, number, "")
    count = int(np.prod(dtype.shape)) if dtype.shape else None
    return WireField(name, number, "u1" if name in ENUM_FIELDS else dtype.base.str[1:], count)


def wire_format_of(record: np.dtype, descriptor: Descriptor, counts: Mapping[str, int]) -> WireFormat | None:
    """Return the format of messages that an older or a newer version wrote, by the descriptor in their file.

    counts: how long the arrays of its messages are, by field. None where a field has a form that we never wrote, or
    another one than the record asks for: such messages are for the protobuf library.
    """
    fields = []
    for field in sorted(descriptor.fields, key=lambda field: field.number):
        payload = _PAYLOADS.get(field.type, "")
        if field.name == ERRORS_FIELD and field.type == FieldDescriptor.TYPE_STRING:
            fields.append(WireField(field.name, field.number, ""))
            continue
        count = counts.get(field.name, 0) if field.is_repeated else None
        found = WireField(field.name, field.number, payload, count)
        known = field.name in (record.names or ()) and field.name != "t_ns"
        if not payload or (known and found != _own_field(record, field.name, field.number)):
            return None
        fields.append(found)
    return WireFormat(record, fields) if fields else None


_PAYLOADS = {
    FieldDescriptor.TYPE_ENUM: "u1",
    FieldDescriptor.TYPE_DOUBLE: "f8",
    FieldDescriptor.TYPE_SFIXED64: "i8",
}
