"""The topic table. Rings, log, schema, reader, review, CSV, live feed and the log's documentation are made from it.

A topic that is added here is in all of them: docs/howto/topic.md.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hal.record import Field, record_of
from hal.tracker import OBJECT_POSE_FIELDS
from rtstack.samples import ARM_FIELDS, CONTROL_FIELDS, EVENT_FIELDS, SIDES, TIMING_FIELDS

PACKAGE = "rtstack"  # of the messages whose schema is made from the table


@dataclass(frozen=True)
class Message:
    """What the samples of a topic are. schema: rtstack.NAME, or one of Foxglove's (rtstack.log.standard has them)."""

    schema: str
    text: str
    fields: tuple[Field, ...]

    @cached_property
    def record(self) -> np.dtype:
        """The samples in memory: t_ns and the fields. In the file the message's log time is t_ns."""
        return record_of(self.fields)

    @property
    def name(self) -> str:
        """The schema without its package."""
        return self.schema.rpartition(".")[2]

    @property
    def is_ours(self) -> bool:
        """Whether its schema is made from the fields."""
        return self.schema.startswith(f"{PACKAGE}.")


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table.

    rate_hz: nominal; 0 for events. every_tick: published in every tick of every run: the log waits for it. plotted:
    whether the review has its fields as curves, in the group that the topic's name begins with.
    """

    name: str
    message: Message
    rate_hz: int
    text: str = ""
    every_tick: bool = False
    plotted: bool = True

    @property
    def record(self) -> np.dtype:
        """The dtype of its samples."""
        return self.message.record

    @property
    def group(self) -> str:
        """The first part of its name: left, right, timing, object."""
        return self.name.split("/")[1]

    @property
    def plotted_fields(self) -> tuple[Field, ...]:
        """The fields that are curves."""
        return tuple(field for field in self.message.fields if self.plotted and field.plotted)


ARM = Message(
    "rtstack.ArmSample",
    "State of one arm, with libfranka's names and units, and the torques wanted and applied.",
    ARM_FIELDS,
)
CONTROL = Message("rtstack.ControlSample", "What the controller of one arm did in this tick.", CONTROL_FIELDS)
TIMING = Message("rtstack.TimingSample", "How the real-time loop kept time.", TIMING_FIELDS)
POSE = Message("foxglove.PoseInFrame", "Pose of an object, in a frame.", OBJECT_POSE_FIELDS)
EVENT = Message("foxglove.Log", "Something that happened.", EVENT_FIELDS)

ARM_TOPICS = tuple(f"/{side}/arm" for side in SIDES)
CONTROL_TOPICS = tuple(f"/{side}/control" for side in SIDES)
TIMING_TOPIC, OBJECT_TOPIC, EVENT_TOPIC = "/timing", "/object/pose", "/events"


def topic_table(rows: Iterable[Topic]) -> dict[str, Topic]:
    """Return the rows by name. Raises ValueError for two that cannot be told apart."""
    table: dict[str, Topic] = {}
    curves: dict[tuple[str, str], str] = {}
    for topic in rows:
        if topic.name in table:
            raise ValueError(f"there are two topics {topic.name}")
        table[topic.name] = topic
        for field in topic.plotted_fields:
            other = curves.setdefault((topic.group, field.name), topic.name)
            if other != topic.name:
                raise ValueError(f"{topic.name} and {other} both have a curve {topic.group}.{field.name}: rename one")
    return table


# in the order of the log: of samples of one time the first topic comes first
TOPICS: dict[str, Topic] = topic_table(
    (
        *(Topic(name, ARM, 1000, every_tick=True) for name in ARM_TOPICS),
        *(Topic(name, CONTROL, 1000, every_tick=True) for name in CONTROL_TOPICS),
        Topic(TIMING_TOPIC, TIMING, 1000, every_tick=True),
        Topic(OBJECT_TOPIC, POSE, 100, "what the tracker saw"),
        Topic(EVENT_TOPIC, EVENT, 0, "who (`name`), what (`message`), how severe", plotted=False),
    )
)
TICK_TOPICS = tuple(topic.name for topic in TOPICS.values() if topic.every_tick)
PLOTTED_TOPICS = tuple(topic.name for topic in TOPICS.values() if topic.plotted)
MESSAGES: dict[str, Message] = {t.message.name: t.message for t in TOPICS.values() if t.message.is_ours}
HOST_CLOCK_FIELDS: dict[str, tuple[str, ...]] = {
    name: clocked
    for name, topic in TOPICS.items()
    if (clocked := tuple(field.name for field in topic.message.fields if field.host_clock))
}
