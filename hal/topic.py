"""A topic of the log: what its samples are, and how often they come. rtstack.topics is the table of all of them."""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hal.base.record import Field, record_of

PACKAGE = "rtstack"  # of the messages whose schema is made from the table


@dataclass(frozen=True)
class Message:
    """What the samples of a topic are. schema: rtstack.NAME, or one of Foxglove's (rtstack.log.viewers.standard)."""

    schema: str
    text: str
    fields: tuple[Field, ...]

    @cached_property
    def record(self) -> np.dtype[Any]:
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

    rate_hz: nominal; 0 for events. every_tick: published in every tick of every run: the log waits for it. plotted: the
    review has its fields as curves, in the group that the topic's name begins with.
    """

    name: str
    message: Message
    rate_hz: int
    text: str = ""
    every_tick: bool = False
    plotted: bool = True

    def __post_init__(self) -> None:
        """Raises ValueError for a name, or a schema, that the log has no place for."""
        if not re.fullmatch(r"(/[a-z][a-z0-9_]*)+", self.name):
            raise ValueError(f"topic {self.name!r}: expected a name as /GROUP/NAME, in lower case")
        if not re.fullmatch(r"(rtstack|foxglove)\.[A-Z][A-Za-z0-9]*", self.message.schema):
            raise ValueError(f"topic {self.name}: schema {self.message.schema!r}: expected rtstack.NAME of your own")

    @property
    def record(self) -> np.dtype[Any]:
        return self.message.record

    @property
    def group(self) -> str:
        """The first part of its name: left, right, timing, object."""
        return self.name.split("/")[1]

    @property
    def plotted_fields(self) -> tuple[Field, ...]:
        return tuple(field for field in self.message.fields if self.plotted and field.plotted)
