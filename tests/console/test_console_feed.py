"""The live feed speaks Foxglove's protocol as the SDK's own server does, to those who know its address."""

import base64
import json
import socket
import struct
import sys
import threading
import time
from contextlib import suppress

import foxglove
import httpx
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from console.live.feed import Feed
from rtstack.topics import TOPICS
from rtstack.trials.record import frames

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
            info, advertisement = json.loads(client.recv(timeout=60)), json.loads(client.recv(timeout=60))
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
        ours, channels = json.loads(client.recv(timeout=60)), json.loads(client.recv(timeout=60))
        assert ours.keys() >= info.keys() - {"sessionId"}
        assert ours["op"] == info["op"]
        assert ours["capabilities"] == ["time"]
        assert channels["op"] == advertisement["op"]
        assert channels["channels"][0].keys() == advertisement["channels"][0].keys()
        by_topic = {one["topic"]: one for one in channels["channels"]}
        assert by_topic.keys() == {*TOPICS, "/tf", "/scene", "/forces", "/forces/lines"}
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


def test_the_clock_is_told_and_frames_go_on_where_it_begins_again(served):
    address = feed_address(served)
    with connect(address, subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None) as client:
        session = json.loads(client.recv(timeout=60))["sessionId"]
        channels = {one["topic"]: one["id"] for one in json.loads(client.recv(timeout=60))["channels"]}
        wanted = [{"id": 3, "channelId": channels["/left/arm"]}, {"id": 4, "channelId": channels["/tf"]}]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        told: list[int] = []
        pushed_and_received(served, client, told, from_tick=20_000)
        assert told == sorted(told)
        assert told[-1] > 20_000_000_000
        told.clear()
        received = pushed_and_received(served, client, told)  # as a trial does, in a cell of its own
        again = next(k for k, t_ns in enumerate(told) if t_ns < 20_000_000_000)
        assert told[:again] == sorted(told[:again])
        assert told[again:] == sorted(told[again:])
        assert {struct.unpack_from("<BIQ", frame)[2] < 20_000_000_000 for frame in received.values()} == {True}
    with connect(address, subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None) as client:
        assert json.loads(client.recv(timeout=60))["sessionId"] == session


def test_a_clock_that_begins_again_is_told_between_the_last_event_and_the_first(served):
    feed = Feed(served.rings, frames(served.parts.cell, "rice_box"))
    (channel,) = [one["id"] for one in json.loads(feed.advertisement())["channels"] if one["topic"] == "/events"]
    feed.hear(json.dumps({"op": "subscribe", "subscriptions": [{"id": 3, "channelId": channel}]}))

    def push(topic, times_ms):
        record, pusher = np.zeros(1, TOPICS[topic].record), served.rings.pusher(topic)
        for t_ms in times_ms:
            record["t_ns"] = t_ms * 1_000_000
            pusher.push(record)

    push("/left/arm", range(20_000, 20_030))
    feed.poll()
    push("/left/arm", [*range(20_030, 20_060), *range(1, 30)])
    push("/events", (20_060, 0))
    told = []
    for frame in feed.poll():
        told.append((frame[0], struct.unpack_from("<Q", frame, 5 if frame[0] == 1 else 1)[0] // 1_000_000))
    again = told.index((1, 20_060)) + 1
    assert {kind for kind, _ in told[: again - 1]} == {2}
    assert told[again : again + 2] == [(2, 0), (1, 0)]
    assert {kind for kind, t_ms in told[again + 2 :] if 0 < t_ms < 30} == {2}


def test_a_client_may_subscribe_while_its_messages_are_put_together(served):
    feed, ends = Feed(served.rings, frames(served.parts.cell, "rice_box")), threading.Event()
    pusher, record = served.rings.pusher("/left/arm"), np.zeros(1, TOPICS["/left/arm"].record)
    record["O_T_EE"] = np.eye(4)
    everything = [{"id": number, "channelId": 1 + number} for number in range(1 + len(TOPICS))]

    def change_the_mind():
        while not ends.is_set():
            feed.hear(json.dumps({"op": "subscribe", "subscriptions": everything}))
            feed.hear(json.dumps({"op": "unsubscribe", "subscriptionIds": list(range(1 + len(TOPICS)))}))

    client, interval_s = threading.Thread(target=change_the_mind), sys.getswitchinterval()
    client.start()
    try:
        sys.setswitchinterval(1e-6)  # threads meet anywhere
        for tick in range(600):
            record["t_ns"] = tick * 50_000_000
            pusher.push(record)
            feed.poll()
    finally:
        sys.setswitchinterval(interval_s)
        ends.set()
        client.join()


def pushed_and_received(served, client, told=None, from_tick=0):
    """Push states of both arms until a message of each of two subscriptions has come; told: the clock's times, ns.

    No message is of a time that was not told before.
    """
    told = [] if told is None else told
    pushers = {side: served.rings.pusher(f"/{side}/arm") for side in ("left", "right")}
    record = np.zeros(1, TOPICS["/left/arm"].record)
    record["O_T_EE"] = np.eye(4)
    frames, tick, deadline_s = {}, from_tick, time.monotonic() + 30.0
    began_ns, ended_ns = from_tick * 1_000_000, (from_tick + 20_000) * 1_000_000  # what came before is passed over
    while frames.keys() != {3, 4}:
        assert time.monotonic() < deadline_s
        for _ in range(50):
            tick += 1
            record["t_ns"] = tick * 1_000_000
            record["q"] = tick * 1_000_000 * 1e-9
            for pusher in pushers.values():
                pusher.push(record)
        with suppress(TimeoutError):
            while True:  # all that has come
                frame = client.recv(timeout=0.1)
                if frame[0] == 2:
                    told.append(struct.unpack_from("<Q", frame, 1)[0])
                    continue
                _, number, t_ns = struct.unpack_from("<BIQ", frame)
                assert t_ns <= told[-1] + 10_000_000
                if began_ns < t_ns < ended_ns:
                    frames[number] = frame
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
    assert httpx.get(f"{served.base}/api/foxglove", trust_env=False, timeout=60.0).status_code == 401


def test_an_address_ends_with_the_session_that_was_told_it(served):
    cookies, headers = served.second_session()
    with httpx.Client(base_url=served.base, cookies=cookies, headers=headers, trust_env=False, timeout=60.0) as client:
        address = client.get("/api/foxglove").json()["address"]
        other = feed_address(served)
        assert other != address
        with connect(address, subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None) as watching:
            watching.recv(timeout=60), watching.recv(timeout=60)
            client.post("/api/sign-out").raise_for_status()
            with pytest.raises(ConnectionClosed) as closing:
                watching.recv(timeout=60)
            assert closing.value.rcvd.code == 1008
    with (
        pytest.raises(InvalidStatus) as refusal,
        connect(address, subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None),
    ):
        pass
    assert refusal.value.response.status_code == 403
    with connect(other, subprotocols=[PROTOCOL], additional_headers=FOREIGN, proxy=None) as watching:
        assert json.loads(watching.recv(timeout=60))["op"] == "serverInfo"
