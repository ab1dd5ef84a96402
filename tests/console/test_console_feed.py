"""The live feed speaks Foxglove's protocol as the SDK's own server does, to those who know its address."""

import base64
import json
import socket
import struct
import time

import foxglove
import httpx
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from rtstack.samples import TOPICS

PROTOCOL = "foxglove.sdk.v1"
FOREIGN = {"origin": "https://app.foxglove.dev"}


def feed_address(served):
    with served.signed_in() as (client, _):
        return client.get("/api/foxglove").json()["address"]


def test_it_says_the_same_as_the_sdk_and_its_messages_decode(served):
    context = foxglove.Context()
    schema = foxglove.Schema(name="a.B", encoding="protobuf", data=b"abc")
    channel = foxglove.Channel("/t", schema=schema, message_encoding="protobuf", context=context)
    theirs = foxglove.start_server(name="theirs", host="127.0.0.93", port=0, context=context)
    try:
        with connect(f"ws://127.0.0.93:{theirs.port}", subprotocols=[PROTOCOL], proxy=None) as client:
            info, advertisement = json.loads(client.recv(timeout=10)), json.loads(client.recv(timeout=10))
            client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel.id()}]}))
            deadline_s, frame = time.monotonic() + 30.0, None
            while frame is None:
                assert time.monotonic() < deadline_s
                channel.log(b"payload", log_time=12345)
                try:
                    frame = client.recv(timeout=0.2)
                except TimeoutError:
                    continue
            assert frame == struct.pack("<BIQ", 1, 7, 12345) + b"payload"
    finally:
        theirs.stop()
    with connect(feed_address(served), subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None) as client:
        assert client.subprotocol == PROTOCOL
        ours, channels = json.loads(client.recv(timeout=10)), json.loads(client.recv(timeout=10))
        assert ours.keys() >= info.keys() - {"sessionId"}
        assert ours["op"] == info["op"]
        assert ours["capabilities"] == []
        assert channels["op"] == advertisement["op"]
        assert channels["channels"][0].keys() == advertisement["channels"][0].keys()
        by_topic = {one["topic"]: one for one in channels["channels"]}
        assert by_topic.keys() == {*TOPICS, "/tf"}
        for nonsense in ("{", "[]", '{"op": "subscribe"}', '{"op": "subscribe", "subscriptions": [{"id": -1}]}'):
            client.send(nonsense)
        arm = by_topic["/left/arm"]
        wanted = [{"id": 3, "channelId": arm["id"]}, {"id": 4, "channelId": by_topic["/tf"]["id"]}]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        frames = pushed_and_received(served, client)
        opcode, _, t_ns = struct.unpack_from("<BIQ", frames[3])
        assert opcode == 1
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(arm["schema"])).file:
            pool.Add(file)
        message = message_factory.GetMessageClass(pool.FindMessageTypeByName(arm["schemaName"]))
        assert list(message.FromString(frames[3][13:]).q) == [t_ns * 1e-9] * 7


def pushed_and_received(served, client):
    """Push states of both arms until a message of each of two subscriptions has come."""
    pushers = {side: served.rings.pusher(f"/{side}/arm") for side in ("left", "right")}
    record = np.zeros(1, TOPICS["/left/arm"])
    record["O_T_EE"] = np.eye(4)
    frames, tick, deadline_s = {}, 0, time.monotonic() + 30.0
    while frames.keys() != {3, 4}:
        assert time.monotonic() < deadline_s
        for _ in range(50):
            tick += 1
            record["t_ns"] = tick * 1_000_000
            record["q"] = tick * 1_000_000 * 1e-9
            for pusher in pushers.values():
                pusher.push(record)
        try:
            frame = client.recv(timeout=0.1)
        except TimeoutError:
            continue
        frames[struct.unpack_from("<I", frame, 1)[0]] = frame
    return frames


@pytest.mark.parametrize("change", ["word", "host", "protocol", "none"])
def test_only_who_knows_the_address_watches(served, change):
    address = feed_address(served)
    protocols = [PROTOCOL]
    if change == "word":
        address = address[:-3] + "abc"
    elif change == "none":
        address = address.rsplit("/", 1)[0] + "/"
    elif change == "host":
        address = address.replace("127.0.0.1", "evil.example")
    else:
        protocols = []
    with (
        socket.create_connection(("127.0.0.1", served.port)) as ours,
        pytest.raises(InvalidStatus) as refusal,
        connect(address, sock=ours, subprotocols=protocols or None, additional_headers=FOREIGN, proxy=None),
    ):
        pass
    assert refusal.value.response.status_code == 403


def test_the_address_is_told_to_who_is_signed_in(served):
    assert httpx.get(f"{served.base}/api/foxglove", trust_env=False).status_code == 401
