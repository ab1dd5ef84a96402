"""Messages of a log back into records, for every topic of the table.

Messages that our encoder wrote, in this version or another, are decoded in one go: the schema inside the file and its
first message tell how their bytes lie. Any other valid protobuf encoding is for the protobuf library, one by one.
"""

from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.records import Schema
from numpy.typing import NDArray

from rtstack.log.errors import LogError
from rtstack.log.viewers.standard import STANDARD
from rtstack.log.writing.encoding import WireFormat, sample_descriptors, wire_format, wire_format_of
from rtstack.topics import TOPICS


def message_class(schema: Schema) -> type[Any]:
    """Return the protobuf class that a schema of the file describes. Raises LogError for a broken one."""
    try:
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    except Exception as error:
        raise LogError(f"the schema {schema.name} in the log is broken: {error}") from error


class TopicDecoder:
    """Decodes the messages of one topic into records of its dtype."""

    def __init__(self, topic: str, schema: Schema) -> None:
        self._topic = topic
        self._ours = TOPICS[topic].message
        self._record = self._ours.record
        self._message = message_class(schema)
        self._wire: WireFormat | None = None
        self._learns = self._ours.is_ours
        if self._learns and schema.data == sample_descriptors():
            self._wire, self._learns = wire_format(self._ours.name), False

    def decode(
        self, data: bytes, t_ns: NDArray[np.int64], start: NDArray[np.int64], size: NDArray[np.int64]
    ) -> NDArray[Any]:
        """Return the records of the messages at data[start : start + size], (n,), with these log times.

        Raises LogError for a message that is not of the topic's schema.
        """
        try:
            records = np.zeros(len(t_ns), self._record)
            rest = np.ones(len(t_ns), np.bool_)
            if self._learns and len(t_ns):
                # another version wrote these messages: the first one shows their format
                message = self._message.FromString(data[start[0] : start[0] + size[0]])
                fields = message.DESCRIPTOR.fields
                counts = {each.name: len(getattr(message, each.name)) for each in fields if each.is_repeated}
                self._wire, self._learns = wire_format_of(self._ours, message.DESCRIPTOR, counts), False
            if self._wire is not None:
                records, rest = self._decode_templates(self._wire, records, data, start, size)
            fill = self._fill_sample if self._ours.is_ours else STANDARD[self._ours.schema].fill
            for row in np.flatnonzero(rest).tolist():
                fill(records[row : row + 1], self._message.FromString(data[start[row] : start[row] + size[row]]))
            records["t_ns"] = t_ns
            return records
        except LogError:
            raise
        except Exception as error:  # whatever the library and numpy make of another type
            raise LogError(f"a message of {self._topic} is broken: {error}") from error

    def _decode_templates(
        self, wire: WireFormat, records: NDArray[Any], data: bytes, start: NDArray[np.int64], size: NDArray[np.int64]
    ) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Decode what fits the template into `records`; return the records, and which messages are left."""
        long_enough = np.flatnonzero(size >= wire.size)
        if not len(long_enough):
            return records, np.ones(len(start), np.bool_)
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), wire.size)
        decoded, mine = wire.decode(windows[start[long_enough]])
        for index in np.flatnonzero(size[long_enough] > wire.size).tolist():
            row = long_enough[index]
            masks = wire.decode_tail(data[start[row] + wire.size : start[row] + size[row]])
            if masks is None:
                mine[index] = False
                continue
            for name, mask in masks.items():
                decoded[name][index] = mask
        rest = np.ones(len(start), np.bool_)
        rest[long_enough[mine]] = False
        if not rest.any():
            return decoded, rest  # all of them, in order: no need to copy
        records[long_enough[mine]] = decoded[mine]
        return records, rest

    def _fill_sample(self, record: NDArray[Any], message: Any) -> None:
        for field in self._ours.fields:
            name = field.name
            if name not in message.DESCRIPTOR.fields_by_name:
                continue
            value = getattr(message, name)
            if field.bits:
                record[name] = sum({1 << field.bits.index(each) for each in value if each in field.bits})
            elif not self._record[name].shape:
                record[name] = value
            elif len(value):
                array = np.array(value)
                if array.size != record[name].size:
                    raise LogError(f"{self._topic}: {name} has {array.size} values, not {record[name].size}")
                if field.column_major:
                    record[name] = array.reshape(self._record[name].shape[::-1]).T
                else:
                    record[name] = array.reshape(record[name].shape)
