"""What is in a log: its metadata, its events, and its topics as numpy records.

A record's fields are libfranka's names. Times are the robot's, in ns; both arms have a topic of their own.
"""

from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log
from rtstack.samples import Mode

log = read_log(Path("trial.mcap"))

print(f"{log.duration_s:.3f} s of", ", ".join(log.topics))
print("controller:", log.metadata["result"]["controller"])
print("attached:", ", ".join(attachment.name for attachment in log.attachments))
for event in log.events:
    print(f"{(event.t_ns - log.start_ns) * 1e-9:7.3f} s  {event.name}: {event.text}")

arm = log.topic("/left/arm")  # (ticks,) records, one a millisecond
control = log.topic("/left/control")
print("largest joint speeds, rad/s:", np.abs(arm["dq"]).max(axis=0).round(2))
print("ms in interim mode:", int((control["mode"] == Mode.INTERIM).sum()))
