"""The topic table refuses rows that its users could not tell apart."""

import pytest

from hal.record import Field
from hal.topic import Message, Topic
from rtstack.topics import TOPICS, topic_table


def test_two_topics_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="two topics /timing"):
        topic_table([*TOPICS.values(), TOPICS["/timing"]])


def test_two_curves_of_one_name_are_refused() -> None:
    mine = Topic(
        "/left/glove", Message("rtstack.Glove", "A glove.", (Field("q", "Finger joints, {unit}.", "rad"),)), 100
    )
    with pytest.raises(ValueError, match=r"/left/glove and /left/arm both have a curve left\.q: rename one"):
        topic_table([*TOPICS.values(), mine])


def test_every_text_says_its_unit() -> None:
    for topic in TOPICS.values():
        for field in topic.message.fields:
            ascii_units = field.unit.split(", ") if field.unit else []
            assert all(f" {unit}" in field.comment for unit in ascii_units), field
