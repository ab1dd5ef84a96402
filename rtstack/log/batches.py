"""The path of all samples into a log's file: batches of records, and the end of the file."""

import json
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from rtstack.log.job import Evidence, texts
from rtstack.log.scenery import Messages, Scenery
from rtstack.log.sink import McapSink
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC


class BatchWriter:
    """Writes batches of records, a topic each, and what stands at the end of a log."""

    def __init__(self, sink: McapSink, scenery: Scenery | None) -> None:
        self._sink = sink
        self._scenery = scenery

    @property
    def messages(self) -> int:
        """Number of messages that were written, those for viewers included."""
        return sum(self._sink.messages.values())

    def write(self, batches: dict[str, NDArray]) -> None:
        """Write all of them, in order of robot's time."""
        if any(len(records) for records in batches.values()):
            self._sink.write(batches, self._made(batches))

    def _made(self, batches: dict[str, NDArray]) -> Messages:
        if self._scenery is None:
            return {}
        poses = batches[OBJECT_TOPIC]
        arms = {side: batches[topic] for side, topic in zip(SIDES, ARM_TOPICS, strict=True)}
        return self._scenery.update(arms, poses[poses["seen"] != 0])

    def finish(self, result: Mapping[str, Any], ended: str, evidence: Evidence | None, lost: Mapping[str, int]) -> None:
        """Write result, evidence and the account of what was lost, by topic, and finish the file."""
        counts = {topic: {"messages": n, "lost": lost.get(topic, 0)} for topic, n in self._sink.messages.items()}
        if evidence is not None:
            for attachment in evidence.attachments:
                self._sink.attach(attachment.name, attachment.media_type, attachment.data)
            self._sink.write_metadata("fault", evidence.fault)
        if result:
            self._sink.write_metadata("result", texts(result))
        account = {
            "ended": ended,
            "messages": str(self.messages),
            "lost": str(sum(lost.values())),
            "topics": json.dumps(counts),
        }
        self._sink.write_metadata("log", account)
        self._sink.close()
