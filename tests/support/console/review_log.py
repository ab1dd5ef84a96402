"""A small log as the review shows it, and how a client reads it."""

import time

import numpy as np

from rtstack.log.mcap_writer import McapWriter
from rtstack.topics import TOPICS

MS = 1_000_000
SPIKE_S = 1.234


def write_log(path, trial, result=None, spike=80.0, complete=True):
    """A log of two seconds with a spike of one sample in a torque and an impact."""
    with open(path, "wb") as file:
        writer = McapWriter(file)
        writer.write_metadata("trial", trial)
        writer.attach("cell.toml", "application/toml", f"[pad]\nsize = {trial.get('seed', 0)}\n".encode())
        batches = {}
        for topic in TOPICS:
            batches[topic] = np.zeros(1 if topic == "/events" else 2000, TOPICS[topic].record)
            batches[topic]["t_ns"] = np.arange(len(batches[topic])) * MS
        batches["/left/arm"]["tau_J"][round(SPIKE_S * 1e3), 3] = spike
        batches["/events"]["t_ns"], batches["/events"]["name"] = int(SPIKE_S * 1e9), b"impact"
        batches["/events"]["text"], batches["/events"]["level"] = b"detected", 2
        writer.write(batches, {})
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
