"""Replay with a soft start and a soft stop, both arms in step: `rtstack play` scales the log's own time.

The speed goes up and down in half a second each, so that no torque jumps; the arms first go to where the log began.
With `--cell fci:LEFT,RIGHT` it is the same on real arms.
"""

import subprocess
from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log

subprocess.run(["rtstack", "play", "ref.mcap", "--speed", "0.5", "--log", "played.mcap"], check=True)

log = read_log(Path("played.mcap"))
left, right = log.topic("/left/arm"), log.topic("/right/arm")
print("both arms in step:", bool((left["t_ns"] == right["t_ns"]).all()), f"in {len(left)} samples")
for when, part in (("first", slice(0, 100)), ("last", slice(-100, None))):
    print(f"{when} 100 ms: at most {np.abs(left['dq'][part]).max():.3f} rad/s")
print(f"in between: {np.abs(left['dq']).max():.3f} rad/s")
