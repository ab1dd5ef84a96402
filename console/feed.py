"""The live data for Foxglove: the topics of the log, from the live rings, over Foxglove's own WebSocket protocol.

Our own few lines of it instead of the SDK's server, which would be a second open port without a sign-in. Watching
only: no capability is announced, and what a client sends beside subscriptions is passed over. Samples are thinned to
100 Hz: the log has all of them. https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

import base64
import json
import struct
from typing import Any

from hal.description import fr3_urdf
from rtstack.log.frames import CellFrames, FrameTree
from rtstack.log.ring import Rings
from rtstack.log.sink import TRANSFORMS, encoded, topic_schemas
from rtstack.samples import SIDES, TOPICS

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
PERIOD_S = 0.05
_EVERY = 10  # of a thousand samples a second
_MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, time ns
_MAX_SUBSCRIPTIONS = 64


def server_info(name: str) -> str:
    """Return the first message of a connection."""
    return json.dumps({"op": "serverInfo", "name": name, "capabilities": [], "metadata": {}, "sessionId": name})


class Feed:
    """What one client sees. `poll` from one thread at a time."""

    def __init__(self, rings: Rings, frames: CellFrames) -> None:
        self._schemas = topic_schemas()
        self._topics = dict(enumerate(self._schemas, start=1))
        self._readers = {topic: rings.reader(topic) for topic in TOPICS}
        self._seen = dict.fromkeys(TOPICS, 0)
        self._tree = FrameTree(frames, fr3_urdf())
        self._subscribed: dict[int, str] = {}

    def advertisement(self) -> str:
        """Return the channels, with their schemas."""
        channels = [
            {
                "id": number,
                "topic": topic,
                "encoding": "protobuf",
                "schemaName": self._schemas[topic].name,
                "schemaEncoding": "protobuf",
                "schema": base64.b64encode(self._schemas[topic].data).decode(),
            }
            for number, topic in self._topics.items()
        ]
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
        except (ValueError, TypeError, KeyError):
            return

    def poll(self) -> list[bytes]:
        """Return the messages since the last call, those that were subscribed to."""
        records = {}
        for topic, reader in self._readers.items():
            new = reader.drain()
            if topic == "/object/pose":
                new = new[new["seen"] != 0]
            elif topic != "/events":
                seen = self._seen[topic]
                self._seen[topic] = seen + len(new)
                new = new[(-seen) % _EVERY :: _EVERY]
            records[topic] = new
        wanted = set(self._subscribed.values())
        messages: dict[str, list[tuple[int, bytes]]] = {}
        for topic in wanted - {TRANSFORMS}:
            messages[topic] = list(zip(records[topic]["t_ns"].tolist(), encoded(topic, records[topic]), strict=True))
        if TRANSFORMS in wanted:
            arms = {side: records[f"/{side}/arm"] for side in SIDES}
            messages[TRANSFORMS] = self._tree.update(arms, records["/object/pose"])
        return [
            _MESSAGE.pack(1, number, max(0, t_ns)) + data
            for number, topic in self._subscribed.items()
            for t_ns, data in messages[topic]
        ]
