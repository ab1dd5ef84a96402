"""The log format's tables: the topic table, and the descriptors that are inside every log."""

from google.protobuf.descriptor_pb2 import FileDescriptorProto

from hal.base.record import Field
from hal.topic import Topic
from rtstack.log.writing.encoding import sample_file
from rtstack.topics import HOST_CLOCK_FIELDS, MESSAGES, TOPICS


def topic_table() -> str:
    """Return the rows of the topics that are recorded, in Markdown: topics of one message in one row."""
    rows: dict[str, list[str]] = {}
    for topic in TOPICS.values():
        row = f"{_schema(topic)} | {_rate(topic.rate_hz)} | {topic.text or topic.message.text}"
        rows.setdefault(row, []).append(f"`{topic.name}`")
    return "\n".join(f"| {', '.join(names)} | {row} |" for row, names in rows.items())


def _schema(topic: Topic) -> str:
    name = topic.message.schema
    return f"[`{name}`](#{name.lower().replace('.', '')})" if topic.message.is_ours else f"`{name}`"


def _rate(hz: int) -> str:
    return "events" if not hz else f"{hz // 1000} kHz" if hz % 1000 == 0 else f"{hz} Hz"


def log_messages() -> str:
    """Return the tables of our own messages, in Markdown: topics, fields, units, and what the enumerations mean."""
    parts = []
    for message in MESSAGES.values():
        topics = ", ".join(f"`{topic.name}`" for topic in TOPICS.values() if topic.message is message)
        parts += [f"### {message.schema}", "", f"{topics}. {message.text}", ""]
        parts += ["| field | type | unit | frame | what |", "|---|---|---|---|---|"]
        parts += [
            f"| `{field.name}` | {_kind(field)} | {field.unit} | {field.frame} | {field.comment} |"
            for field in message.fields
        ]
        parts.append("")
    return "\n".join([*parts, *_enumerations(sample_file())])


def host_clock_fields() -> str:
    """Return the fields that the host's clock fills, in one line."""
    return "; ".join(
        f"in `{topic}` " + ", ".join(f"`{n}`" for n in names) for topic, names in HOST_CLOCK_FIELDS.items()
    )


def _kind(field: Field) -> str:
    if field.enum is not None:
        return f"[{field.enum.__name__}](#{field.enum.__name__.lower()})"
    if field.bits:
        return "string[]"
    size = 1
    for length in field.dtype.shape:
        size *= length
    return ("sfixed64" if field.kind == "i8" else "double") + (f"[{size}]" if field.dtype.shape else "")


def _enumerations(file: FileDescriptorProto) -> list[str]:
    lines = []
    for enum in file.enum_type:
        lines += [f"### {enum.name}", ""]
        lines += [", ".join(f"{value.number} `{value.name}`" for value in enum.value) + ".", ""]
    return lines
