"""Messages of a log back into records, for every topic of rtstack.samples.

Messages that our encoder wrote, in this version or another, are decoded in one go: the schema inside the file and its
first message tell how their bytes lie. Any other valid protobuf encoding is for the protobuf library, one by one.
"""

from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.records import Schema
from numpy.typing import NDArray

from hal.robot_errors import ROBOT_ERRORS, error_bit
from rtstack.log.encoding import WireFormat, wire_format, wire_format_of
from rtstack.log.errors import LogError
from rtstack.log.schema import COLUMN_MAJOR_FIELD, ERRORS_FIELD, TOPIC_MESSAGES, sample_descriptors
from rtstack.samples import TOPICS


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
        self._record = TOPICS[topic]
        self._message = message_class(schema)
        self._wire: WireFormat | None = None
        self._learns = topic in TOPIC_MESSAGES
        if self._learns and schema.data == sample_descriptors():
            self._wire, self._learns = wire_format(TOPIC_MESSAGES[topic]), False

    def decode(
        self, data: bytes, t_ns: NDArray[np.int64], start: NDArray[np.int64], size: NDArray[np.int64]
    ) -> NDArray[Any]:
        """Return the records of the messages at data[start : start + size], shape (n,), with these log times.

        Raises LogError for a message that is not of the topic's schema.
        """
        records = np.zeros(len(t_ns), self._record)
        rest = np.ones(len(t_ns), np.bool_)
        if self._learns and len(t_ns):
            self._wire, self._learns = self._learnt(data[start[0] : start[0] + size[0]]), False
        if self._wire is not None:
            records, rest = self._decode_templates(self._wire, records, data, start, size)
        for row in np.flatnonzero(rest).tolist():
            self._fill(records[row : row + 1], self._parsed(data[start[row] : start[row] + size[row]]))
        records["t_ns"] = t_ns
        return records

    def _parsed(self, data: bytes) -> Any:
        try:
            return self._message.FromString(data)
        except Exception as error:
            raise LogError(f"a message of {self._topic} is broken: {error}") from error

    def _learnt(self, data: bytes) -> WireFormat | None:
        """The format of another version's messages, of which this is one."""
        message, descriptor = self._parsed(data), self._message.DESCRIPTOR
        counts = {field.name: len(getattr(message, field.name)) for field in descriptor.fields if field.is_repeated}
        return wire_format_of(self._record, descriptor, counts)

    def _decode_templates(
        self,
        wire: WireFormat,
        records: NDArray[Any],
        data: bytes,
        start: NDArray[np.int64],
        size: NDArray[np.int64],
    ) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Decode what fits the template into `records`; return the records, and which messages are left."""
        long_enough = np.flatnonzero(size >= wire.size)
        if not len(long_enough):
            return records, np.ones(len(start), np.bool_)
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), wire.size)
        decoded, mine = wire.decode(windows[start[long_enough]])
        for index in np.flatnonzero(size[long_enough] > wire.size).tolist():
            row = long_enough[index]
            errors = wire.decode_tail(data[start[row] + wire.size : start[row] + size[row]])
            if errors is None:
                mine[index] = False
            else:
                decoded[ERRORS_FIELD][index] = errors
        rest = np.ones(len(start), np.bool_)
        rest[long_enough[mine]] = False
        if not rest.any():
            return decoded, rest  # all of them, in order: no need to copy
        records[long_enough[mine]] = decoded[mine]
        return records, rest

    def _fill(self, record: NDArray[Any], message: Any) -> None:
        if self._topic == "/object/pose":
            p, q = message.pose.position, message.pose.orientation
            record["position"] = (p.x, p.y, p.z)
            record["orientation_wxyz"] = (q.w, q.x, q.y, q.z)
            record["seen"] = 1
        elif self._topic == "/events":
            record["level"] = message.level
            record["name"] = message.name.encode("ascii", "replace")
            record["text"] = message.message.encode("ascii", "replace")
        else:
            self._fill_sample(record, message)

    def _fill_sample(self, record: NDArray[Any], message: Any) -> None:
        for name in self._record.names or ():
            if name == "t_ns" or name not in message.DESCRIPTOR.fields_by_name:
                continue
            value = getattr(message, name)
            if name == ERRORS_FIELD:
                record[name] = sum({error_bit(error) for error in value if error in ROBOT_ERRORS})
            elif not self._record[name].shape:
                record[name] = value
            elif len(value):
                array = np.array(value)
                if array.size != record[name].size:
                    raise LogError(f"{self._topic}: {name} has {array.size} values, not {record[name].size}")
                array = array.reshape(record[name].shape)
                record[name] = array.transpose(0, 2, 1) if name == COLUMN_MAJOR_FIELD else array
