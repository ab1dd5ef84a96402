"""Records to protobuf and back, whole batches at once.

A sample has a fixed layout, and so have its bytes on the wire: tags and lengths never change, doubles are 8
bytes. The bytes of a message are therefore a structured dtype, and a batch is encoded by copying columns into
an array of it. What does not fit the template (names of errors, an enum value above 127) follows it: protobuf
takes fields in any order, and the last value of a field wins.
https://protobuf.dev/programming-guides/encoding/
"""

from functools import cache
from typing import Any

import numpy as np
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


class WireFormat:
    """One of our messages on the wire: `template` is the dtype of one without errors, `size` its bytes."""

    def __init__(self, message: str) -> None:
        self.record = MESSAGES[message]
        self.tags: dict[str, bytes] = {}
        parts: list[tuple[str, str, int | tuple[int, ...]]] = []
        constants = bytearray()
        names = [name for name in self.record.names or () if name != "t_ns"]
        for number, name in enumerate(names, start=1):
            dtype = self.record[name]
            wire_type = _VARINT if name in ENUM_FIELDS else _LENGTH if dtype.shape or name == ERRORS_FIELD else _I64
            self.tags[name] = tag = varint(number << 3 | wire_type)
            if name == ERRORS_FIELD:
                continue
            prefix = tag + varint(dtype.itemsize) if dtype.shape else tag
            payload = np.dtype("u1") if name in ENUM_FIELDS else dtype
            count = int(np.prod(payload.shape))
            parts.append((f"{name} prefix", "u1", (len(prefix),)))
            parts.append((name, payload.base.str, (count,)))
            constants += prefix + bytes(payload.itemsize)
        self.names = [name for name in names if name != ERRORS_FIELD]
        self.template = np.dtype(parts)
        self.size = self.template.itemsize
        self._empty = np.frombuffer(bytes(constants), self.template)
        # fields whose bytes are on the wire as they are in the record: copied as such, not number by number
        self._plain = [name for name in self.names if name not in ENUM_FIELDS and name != COLUMN_MAJOR_FIELD]
        self._wire_bytes, self._record_bytes = (_as_bytes(dtype, self._plain) for dtype in (self.template, self.record))
        fixed = np.zeros(1, self.template)
        for name in self.names:
            fixed[f"{name} prefix"] = 0xFF
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
    """Return the format of one of the messages of rtstack.log.schema.MESSAGES."""
    return WireFormat(message)
