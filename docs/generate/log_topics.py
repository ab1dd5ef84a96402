"""The log format's tables, from the descriptors that are inside every log."""

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto

from rtstack.log.schema import COLUMN_MAJOR_FIELD, HOST_CLOCK_FIELDS, MESSAGES, TOPIC_MESSAGES, sample_file

_KINDS = {
    FieldDescriptorProto.TYPE_DOUBLE: "double",
    FieldDescriptorProto.TYPE_STRING: "string",
    FieldDescriptorProto.TYPE_SFIXED64: "sfixed64",
}


def log_topics() -> str:
    """Return the tables of our own messages, in Markdown: topics, fields, units, and what the enumerations mean."""
    file = sample_file()
    comments = {tuple(one.path): one.leading_comments.strip() for one in file.source_code_info.location}
    parts = []
    for index, message in enumerate(file.message_type):
        topics = ", ".join(f"`{topic}`" for topic, name in TOPIC_MESSAGES.items() if name == message.name)
        parts += [f"### rtstack.{message.name}", "", f"{topics}. {comments[(4, index)]}", ""]
        parts += ["| field | type | what |", "|---|---|---|"]
        for number, field in enumerate(message.field):
            what = comments[(4, index, 2, number)]
            parts.append(f"| `{field.name}` | {_kind(message.name, field)} | {what} |")
        parts.append("")
    return "\n".join([*parts, *_enumerations(file)])


def host_clock_fields() -> str:
    """Return the fields that the host's clock fills, in one line."""
    return "; ".join(
        f"in `{topic}` " + ", ".join(f"`{n}`" for n in names) for topic, names in HOST_CLOCK_FIELDS.items()
    )


def _kind(message: str, field: FieldDescriptorProto) -> str:
    if field.type == FieldDescriptorProto.TYPE_ENUM:
        name = field.type_name.rpartition(".")[2]
        return f"[{name}](#{name.lower()})"
    record = MESSAGES[message][field.name]
    count = "" if field.name == COLUMN_MAJOR_FIELD else "".join(f"[{size}]" for size in record.shape)
    repeated = field.label == FieldDescriptorProto.LABEL_REPEATED
    many = "[16]" if field.name == COLUMN_MAJOR_FIELD else count or "[]" * repeated
    return _KINDS[field.type] + many


def _enumerations(file: FileDescriptorProto) -> list[str]:
    lines = []
    for enum in file.enum_type:
        lines += [f"### {enum.name}", ""]
        lines += [", ".join(f"{value.number} `{value.name}`" for value in enum.value) + ".", ""]
    return lines
