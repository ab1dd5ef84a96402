"""The path of all samples into a log's file: batches of records, and the end of the file."""

import json
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from rtstack.log.job import Evidence, texts
from rtstack.log.mcap_writer import McapWriter
from rtstack.log.scenery import Messages, Scenery
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC


class BatchWriter:
    """Writes batches of records, a topic each, and what stands at the end of a log."""

    def __init__(self, mcap: McapWriter, scenery: Scenery | None) -> None:
        self._mcap = mcap
        self._scenery = scenery

    @property
    def messages(self) -> int:
        """Number of messages that were written, those for viewers included."""
        return sum(self._mcap.messages.values())

    def write(self, batches: dict[str, NDArray]) -> None:
        """Write all of them, in order of robot's time."""
        if any(len(records) for records in batches.values()):
            self._mcap.write(batches, self._made(batches))

    def _made(self, batches: dict[str, NDArray]) -> Messages:
        if self._scenery is None:
            return {}
        poses = batches[OBJECT_TOPIC]
        arms = {side: batches[topic] for side, topic in zip(SIDES, ARM_TOPICS, strict=True)}
        return self._scenery.update(arms, poses[poses["seen"] != 0])

    def finish(self, result: Mapping[str, Any], ended: str, evidence: Evidence | None, lost: Mapping[str, int]) -> None:
        """Write result, evidence and the account of what was lost, by topic, and finish the file."""
        counts = {topic: {"messages": n, "lost": lost.get(topic, 0)} for topic, n in self._mcap.messages.items()}
        if evidence is not None:
            for attachment in evidence.attachments:
                self._mcap.attach(attachment.name, attachment.media_type, attachment.data)
            self._mcap.write_metadata("fault", evidence.fault)
        if result:
            self._mcap.write_metadata("result", texts(result))
        account = {
            "ended": ended,
            "messages": str(self.messages),
            "lost": str(sum(lost.values())),
            "topics": json.dumps(counts),
        }
        self._mcap.write_metadata("log", account)
        self._mcap.close()
