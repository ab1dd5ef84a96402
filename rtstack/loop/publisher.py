"""Where the loop's samples go: any number of rings, and an in-memory history."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.cycle import Cycles
from hal.host_work import HostWork
from hal.sensor import Sensor
from hal.tracker import ObjectTracker
from rtstack.log.errors import LogError
from rtstack.log.push import push_all
from rtstack.log.ring import Rings
from rtstack.loop.history import History
from rtstack.samples import EVENT, SIDES, TIMING_SAMPLE, Level
from rtstack.topics import (
    ARM_TOPICS,
    CONTROL_TOPICS,
    CYCLE_TOPICS,
    EVENT_TOPIC,
    OBJECT_TOPIC,
    REFUSED,
    TIMING_TOPIC,
    TOPICS,
    WORK_TOPIC,
)

_ALWAYS = np.ones(1, np.int64)


class _Stream:
    """The samples of a topic that come at a rate of their own: each is published once, when its stamp is a new one."""

    def __init__(self, topic: str, rings: Sequence[Rings], history: History | None) -> None:
        if topic not in TOPICS:
            reason = "; ".join(REFUSED) or "declare it (docs/howto/topic.md)"
            raise LogError(f"the topic {topic} of a sensor is not in the topic table: {reason}")
        self.sample = np.zeros(1, TOPICS[topic].record)
        self.sample["t_ns"] = -1
        self._offered = self._known = self.sample
        self._stamp, self._seen = self.sample["t_ns"], _ALWAYS
        self._published_ns = -1
        self._takers: list[Callable[[NDArray], None]] = [ring.pusher(topic).push for ring in rings]
        if history is not None:
            self._takers.append(history.keep(topic))

    def offer(self, sample: NDArray, origin_ns: int, now_ns: int) -> None:
        """Take a sample for the next `publish`; its stamp counts from origin_ns unless that is 0: see `look`."""
        if origin_ns:
            t_ns = sample["t_ns"].item()
            if sample is not self.sample:
                self.sample[:] = sample
            if t_ns >= 0:
                self.sample["t_ns"][0] = min(max(0, t_ns - origin_ns), now_ns)
            sample = self.sample
        self._offered = sample

    def publish(self) -> None:
        """Publish what was offered, where it is new and was seen."""
        sample = self._offered
        if sample is not self._known:
            self._known, self._stamp = sample, sample["t_ns"]
            self._seen = sample["seen"] if "seen" in (sample.dtype.names or ()) else _ALWAYS
        t_ns = self._stamp.item()
        if t_ns != self._published_ns and self._seen[0]:
            self._published_ns = t_ns
            for take in self._takers:
                take(sample)


class Publisher:
    """Publishes a tick to every ring. Events are fixed-size records too: formatting happens on events only. sides: of
    the arms. sensors: read with the object's pose. leads: read once the torques are out, their stamps are the log's.
    Raises LogError for one whose topic is not in the table."""

    def __init__(
        self, rings: Sequence[Rings], history: History | None, sensors: Sequence[Sensor] = (),
        leads: Sequence[Sensor] = (), sides: Sequence[str] = SIDES,
    ) -> None:  # fmt: skip
        there = [SIDES.index(side) for side in sides]
        of_a_tick = (*(topics[k] for k in there for topics in (ARM_TOPICS, CONTROL_TOPICS)), TIMING_TOPIC)
        self.timing = np.zeros(1, TIMING_SAMPLE)
        self._history = history
        self._event = np.zeros(1, EVENT)
        self._cycles = [[ring.pusher(CYCLE_TOPICS[k]).push for ring in rings] for k in there]
        self._work = [ring.pusher(WORK_TOPIC).push for ring in rings]
        self._pushers = [[ring.pusher(topic) for topic in of_a_tick] for ring in rings]
        self._records: Sequence[tuple[NDArray, NDArray]] | None = None
        self._rows = np.zeros((0, 5), np.int64)
        self._object = _Stream(OBJECT_TOPIC, rings, history)
        self._sensors = [(sensor, _Stream(sensor.topic, rings, history)) for sensor in sensors]
        self._leads = [(lead, _Stream(lead.topic, rings, history)) for lead in leads]
        self._streams = [stream for _, stream in (*self._sensors, *self._leads)]
        self._event_takers: list[Callable[[NDArray], None]] = [ring.pusher(EVENT_TOPIC).push for ring in rings]
        if history is not None:
            self._event_takers.append(history.keep(EVENT_TOPIC))

    def look(self, tracker: ObjectTracker, origin_ns: int = 0, now_ns: int = 0) -> None:
        """Take the object's pose and the sensors' samples for the next `tick`; of a robot that waits for its answer,
        before it gets one. origin_ns: robot's time that the log counts from, unless 0, and now_ns, how long ago that
        is. All stands still until the first answer: what was seen before then has the stamp of the first state."""
        self._object.offer(tracker.latest().record, origin_ns, now_ns)
        for sensor, stream in self._sensors:
            sensor.read(stream.sample)
            stream.offer(stream.sample, origin_ns, now_ns)

    def tick(self, records: Sequence[tuple[NDArray, NDArray]]) -> None:
        """Publish the arm and control record (1,) of each arm, the timing, and what was looked at and is new."""
        if records is not self._records:
            self._bind(records)
        self._object.publish()  # before the arms: who has their samples has its pose, as a camera needs it
        if self._pushers:
            push_all(self._rows)
        if self._history is not None:
            self._history.append(records, self.timing)
        for lead, stream in self._leads:
            lead.read(stream.sample)
        for stream in self._streams:
            stream.publish()

    @property
    def median_compute_us(self) -> float:
        """Median of what the ticks have taken so far, us; 0 where none are kept. Not for the tick."""
        took = () if self._history is None else self._history.columns().timing["compute_us"]
        return float(np.median(took)) if len(took) else 0.0

    def cycle(self, side: int, cycle: NDArray[np.void], work: NDArray[np.void] | None) -> None:
        """Publish a cycle of an arm, (1,) of CYCLE, and what the host did, (1,) of WORK, where that was read."""
        for take in self._cycles[side]:
            take(cycle)
        if work is not None:
            for take in self._work:
                take(work)

    def _bind(self, records: Sequence[tuple[NDArray, NDArray]]) -> None:
        """Look up where the records are: the loop publishes the same ones every tick."""
        self._records = records
        every = (*chain.from_iterable(records), self.timing)
        rows = [p.bind(record) for each in self._pushers for p, record in zip(each, every, strict=True)]
        self._rows = np.array(rows, np.int64).reshape(-1, 5)

    def event(self, t_ns: int, level: Level, name: str, text: str) -> None:
        """Publish an event at the robot's time t_ns."""
        self._event["t_ns"][0] = t_ns
        self._event["level"][0] = level
        self._event["name"][0] = name.encode("ascii", "replace")
        self._event["text"][0] = text.encode("ascii", "replace")
        for take in self._event_takers:
            take(self._event)


class CycleReporter:
    """Publishes the cycles of each arm, and what the host did meanwhile. cycles: None where they are not measured;
    stamps: t_ns of the arms' present states, (1,) each."""

    def __init__(self, cycles: Sequence[Cycles] | None, stamps: Sequence[NDArray[Any]], publisher: Publisher) -> None:
        self._arms = [(cycle, cycle.sample["t_ns"], stamp) for cycle, stamp in zip(cycles or (), stamps, strict=False)]
        self._work, self._publisher = HostWork(), publisher

    def measuring(self) -> AbstractContextManager[object]:
        """Return the context in which the host's work for the calling thread is counted."""
        return self._work if self._arms else nullcontext()

    def tick(self, sides: tuple[int, ...]) -> None:
        """Publish the cycles of the arms that were just answered."""
        if not self._arms:
            return
        work = self._work
        for k in sides:
            cycles, own_stamp, stamp = self._arms[k]
            own_stamp[0] = stamp[0]
            read = work.cycle(cycles.late)
            if read:
                work.sample["t_ns"][0] = own_stamp[0]
            self._publisher.cycle(k, cycles.sample, work.sample if read else None)
