"""Protobuf schema of the log's own messages, made from the topic table: a FileDescriptorSet, without protoc.

The field names are the records'. t_ns is no field: MCAP's log_time carries it.
"""

from enum import IntEnum
from functools import cache

from google.protobuf import descriptor_pb2

from hal.record import Field
from hal.topic import PACKAGE
from rtstack.topics import MESSAGES

_Type = descriptor_pb2.FieldDescriptorProto


def _enum_prefix(name: str) -> str:
    return "".join("_" + c if c.isupper() and i else c for i, c in enumerate(name)).upper()


def _add_enum(file: descriptor_pb2.FileDescriptorProto, enum: type[IntEnum]) -> None:
    added = file.enum_type.add(name=enum.__name__)
    for member in enum:
        added.value.add(name=f"{_enum_prefix(enum.__name__)}_{member.name}", number=int(member))


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
    files = descriptor_pb2.FileDescriptorSet(file=[sample_file()])
    return files.SerializeToString(deterministic=True)
