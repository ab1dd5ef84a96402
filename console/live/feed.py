"""The live data for Foxglove: the topics of the log, from the live rings, over Foxglove's own WebSocket protocol.

The SDK's server would be a second open port without a sign-in. Watching only, thinned to 100 Hz. The robot's clock is
told (capability `time`), since stamps are the robot's, and begin again where a simulated cell is opened again.
https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

import base64
import json
import struct
from itertools import pairwise
from typing import Any
from uuid import uuid4

from rtstack.log.ring import Rings
from rtstack.log.viewers.frames import CellFrames
from rtstack.log.viewers.scenery import Scenery, scenery_schemas
from rtstack.log.viewers.voxels import VOXELS
from rtstack.log.writing.mcap_writer import encoded, topic_schemas
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC, TOPICS

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
PERIOD_S = 0.05
_RATE_HZ = 100
_MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, time ns
_TIME = struct.Struct("<BQ")  # opcode 2, time ns
_NEAR_NS = 20_000_000  # what is later than the newest state by more is from before the clock began again
_MAX_SUBSCRIPTIONS = 64
_SESSION = uuid4().hex  # by it a client that connects again knows whether this is still the same console


def server_info(name: str) -> str:
    """Return the first message of a connection."""
    about = {"name": name, "capabilities": ["time"], "metadata": {}, "sessionId": _SESSION}
    return json.dumps({"op": "serverInfo", **about})


class Feed:
    """What one client sees. `poll` from one thread at a time, `hear` from another one if need be."""

    def __init__(self, rings: Rings, frames: CellFrames) -> None:
        # without the voxels, which are said once: /scene says the same each second
        no_arm = tuple(f"/{side}/" for side in SIDES if side not in frames.sides)
        schemas = topic_schemas().items()
        self._schemas = {name: each for name, each in schemas if name not in VOXELS and not name.startswith(no_arm)}
        self._made = self._schemas.keys() & scenery_schemas().keys()
        self._topics = dict(enumerate(self._schemas, start=1))
        self._readers = {topic: rings.reader(topic) for topic in TOPICS}
        self._counted = dict.fromkeys(TOPICS, 0)
        self._frames = frames
        self._clock_topic = ARM_TOPICS[SIDES.index(frames.sides[0])]
        self._scenery = Scenery(frames)
        self._now_ns = 0
        self._subscribed: dict[int, str] = {}

    def advertisement(self) -> str:
        """Return the channels, with their schemas."""
        channels, form = [], {"encoding": "protobuf", "schemaEncoding": "protobuf"}
        for number, topic in self._topics.items():
            schema = self._schemas[topic]
            described = {"schemaName": schema.name, "schema": base64.b64encode(schema.data).decode()}
            channels.append({"id": number, "topic": topic, **form, **described})
        return json.dumps({"op": "advertise", "channels": channels})

    def hear(self, text: str) -> None:
        """Take a client's subscriptions; anything else, and what is no message, is passed over."""
        try:
            message: Any = json.loads(text)
            if message["op"] == "subscribe":
                for asked in message["subscriptions"]:
                    number, topic = int(asked["id"]), self._topics[int(asked["channelId"])]
                    if 0 <= number < 1 << 32 and len(self._subscribed) < _MAX_SUBSCRIPTIONS:
                        self._subscribed[number] = topic
            elif message["op"] == "unsubscribe":
                for number in message["subscriptionIds"]:
                    self._subscribed.pop(int(number), None)
        except (ValueError, TypeError, KeyError, RecursionError):
            return

    def poll(self) -> list[bytes]:
        """Return the messages since the last call, those that were subscribed to, each after the time that it is."""
        subscribed = self._subscribed.copy()  # the client may send another one meanwhile
        records = self._thinned()
        # the stamps of the first arm are told as the time: two control boxes have two clocks
        earlier, clock = self._clock(records[self._clock_topic]["t_ns"].tolist())
        poses = records[OBJECT_TOPIC]
        arms = {side: records[topic] for side, topic in zip(SIDES, ARM_TOPICS, strict=True)}
        if earlier is not None:
            self._scenery = Scenery(self._frames)  # its transforms are due by a clock that goes on
            poses = poses[poses["t_ns"] <= clock[-1]]
            arms = {side: samples[samples["t_ns"] <= clock[-1]] for side, samples in arms.items()}
        wanted = set(subscribed.values())
        messages: dict[str, list[tuple[int, bytes]]] = {}
        for topic in wanted - self._made:
            messages[topic] = list(zip(records[topic]["t_ns"].tolist(), encoded(topic, records[topic]), strict=True))
        if wanted & self._made:
            messages |= {topic: [] for topic in self._made} | self._scenery.update(arms, poses)
        due = [
            (t_ns, _MESSAGE.pack(1, number, max(0, t_ns)) + data)
            for number, topic in subscribed.items()
            for t_ns, data in messages[topic]
        ]
        if earlier is None:
            return _timed(due, clock)
        before, after = ([one for one in due if (one[0] > clock[-1] + _NEAR_NS) is old] for old in (True, False))
        began_ns = min([clock[0], *(t_ns for t_ns, _ in after)])  # the first event is told with its own time
        return _timed(before, earlier) + _timed(after, [began_ns, *clock])

    def _thinned(self) -> dict[str, Any]:
        """Return what has come since the last call, of each topic."""
        records = {}
        for topic, reader in self._readers.items():
            new = reader.drain()
            if "seen" in (new.dtype.names or ()):
                new = new[new["seen"] != 0]
            every, counted = max(1, TOPICS[topic].rate_hz // _RATE_HZ), self._counted[topic]
            self._counted[topic] += len(new)
            records[topic] = new[-counted % every :: every]
        return records

    def _clock(self, stamps: list[int]) -> tuple[list[int] | None, list[int]]:
        """Return the stamps before the clock began again, None where it went on, and the others."""
        known = [self._now_ns, *stamps]
        again = [k for k, (one, other) in enumerate(pairwise(known)) if other < one]
        self._now_ns = known[-1]
        return (stamps[: again[-1]], stamps[again[-1] :]) if again else (None, stamps)


def _timed(messages: list[tuple[int, bytes]], clock: list[int]) -> list[bytes]:
    """Return messages in the order of their stamps, each time of the clock before what is from then on."""
    times = [(t_ns, _TIME.pack(2, max(0, t_ns))) for t_ns in clock]
    return [frame for _, frame in sorted(times + messages, key=lambda one: one[0])]
