"""A small log as the review shows it, and how a client reads it."""

import io
import json
import time

import numpy as np
from PIL import Image

from rtstack.cameras.source import draw_time
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log.writing.pictures import LoggedCamera, camera_schemas, picture_message
from rtstack.samples import SIDES
from rtstack.topics import TOPICS
from tests.support.drawn_time import read_time

MS = 1_000_000
SPIKE_S = 1.234


def stamped_pictures(periods_ms):
    """Cameras for `write_log`, with a picture every so many ms and its time drawn into it."""
    return [
        (
            LoggedCamera(name, "", 400, 96, (1.0,) * 9, (), (0.0,) * 7),
            [(t_ms * MS, _stamped(t_ms * MS)) for t_ms in range(0, 2000, period_ms)],
        )
        for name, period_ms in periods_ms.items()
    ]


def _stamped(t_ns):
    picture = np.full((96, 400, 3), 90, np.uint8)
    draw_time(picture, t_ns)
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG")
    return file.getvalue()


def time_in(jpeg):
    """The time that is drawn into a picture, ns."""
    return read_time(np.array(Image.open(io.BytesIO(jpeg))))


def write_log(path, trial, result=None, spike=80.0, complete=True, pictures=(), sides=SIDES):
    """A log of two seconds with a spike of one sample in a torque and an impact.

    pictures: a LoggedCamera and its (t_ns, JPEG), of each camera. sides: of the arms that it has.
    """
    no_arm = tuple(f"/{side}/" for side in SIDES if side not in sides)
    with open(path, "wb") as file:
        schemas = {
            topic: each for camera, _ in pictures for topic, each in camera_schemas(camera.name, camera.video).items()
        }
        writer = McapWriter(file, schemas)
        writer.write_metadata("trial", trial)
        writer.attach("cell.toml", "application/toml", f"[pad]\nsize = {trial.get('seed', 0)}\n".encode())
        batches = {}
        for topic in [topic for topic in TOPICS if not topic.startswith(no_arm)]:
            batches[topic] = np.zeros(1 if topic == "/events" else 2000, TOPICS[topic].record)
            batches[topic]["t_ns"] = np.arange(len(batches[topic])) * MS
        batches[f"/{sides[0]}/arm"]["tau_J"][round(SPIKE_S * 1e3), 3] = spike
        batches["/events"]["t_ns"], batches["/events"]["name"] = int(SPIKE_S * 1e9), b"impact"
        batches["/events"]["text"], batches["/events"]["level"] = b"detected", 2
        made = {
            camera.topics[0]: [(t, picture_message(camera.name, t, data, camera.video)) for t, data in shown]
            for camera, shown in pictures
        }
        writer.write(batches, made)
        if not complete:
            writer.flush()
            return
        writer.write_metadata("result", result or {})
        writer.close()


def read(client, log_id):
    """Ask for a log until all of it has been read."""
    deadline_s = time.monotonic() + 120.0
    while True:
        document = client.get(f"/api/logs/{log_id}").raise_for_status().json()
        if document["done"]:
            return document
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def unpacked(data):
    """Read the binary answer as its description says, with nothing of ours."""
    length = int(np.frombuffer(data, "<u4", 1)[0])
    header, place, found = json.loads(data[4 : 4 + length]), 4 + length, {}
    for part in header:
        t_s = np.frombuffer(data, "<f8", part["points"], place)
        place += t_s.nbytes
        for name in part["signals"]:
            both = []
            for _ in range(1 if part["bucket"] == 1 else 2):
                both.append(np.frombuffer(data, "<f4", part["points"], place))
                place += -(-both[-1].nbytes // 8) * 8
            found[name] = (t_s, both[0], both[-1])
    assert place == len(data)
    return found
