"""The topic table refuses rows that its users could not tell apart; Unix time of the robot's time as a sample."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from hal.base.record import Field
from hal.clock_relation import ClockRelation
from hal.topic import Message, Topic
from rtstack.cells.robot_clock import EVERY_NS, RobotClock
from rtstack.topics import CLOCK_TOPIC, TOPICS, topic_table


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


DRIFT = 50e-6
SECONDS = 6


def test_a_sample_relates_the_robots_time_to_unix_time_ten_times_a_second():
    arm, relation = SimpleNamespace(t_ns=0), ClockRelation()
    pair = SimpleNamespace(arms={"left": arm})
    clock, sample = RobotClock(pair, relation), np.zeros(1, TOPICS[CLOCK_TOPIC].record)
    sample["t_ns"] = -1
    clock.read(sample)
    assert sample["t_ns"][0] == -1  # nothing is known yet
    begun_ns, rng = time.monotonic_ns(), np.random.default_rng(0)
    for k in range(1000 * SECONDS):
        delay_ns = 100_000 + round(rng.exponential(50_000))
        relation.update(k * 1_000_000, begun_ns + round(k * 1e6 * (1.0 + DRIFT)) + delay_ns)
    clock._t_ns = (SECONDS * 1000 - 1) * 1_000_000
    low_ns = time.time_ns() - time.monotonic_ns()
    clock.read(sample)
    assert sample["t_ns"][0] == clock._t_ns
    assert sample["drift_ppm"][0] == pytest.approx(1e6 * DRIFT, abs=1.0)
    assert 0.0 < sample["uncertainty_us"][0] < 10.0
    assert sample["steps"][0] == 0
    at_ns = begun_ns + clock._t_ns * (1.0 + DRIFT) + 100_000  # the least delay belongs to it
    assert sample["unix_ns"][0] - low_ns == pytest.approx(at_ns, abs=1e6)
    clock._t_ns += EVERY_NS - 1_000_000
    clock.read(sample)
    assert sample["t_ns"][0] < clock._t_ns
    clock._t_ns += 1_000_000
    clock.read(sample)
    assert sample["t_ns"][0] == clock._t_ns
