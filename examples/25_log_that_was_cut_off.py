"""A log that survives a crash: every tick is there, and of a file that was cut off all but the last half second.

`rtstack recover LOG` writes what can be read as a log of its own; `read_log(path, truncated=True)` reads it in place.
"""

import subprocess
from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log

whole = read_log(Path("trial.mcap"))
steps = np.diff(whole.topic("/left/arm")["t_ns"])
print(f"{len(steps) + 1} samples of each arm, the largest step {steps.max() * 1e-6:.0f} ms")
print("ticks missed:", whole.metadata["result"].get("missed_deadlines"), "- a log that falls behind stops the arms")

data = Path("trial.mcap").read_bytes()
Path("cut.mcap").write_bytes(data[: len(data) // 2])  # as if the PC had lost its power
cut = read_log(Path("cut.mcap"), truncated=True)
print(f"cut off: complete {cut.complete}, {cut.duration_s:.2f} of {whole.duration_s:.2f} s")

subprocess.run(["rtstack", "recover", "cut.mcap"], check=True)
print(f"recovered: {read_log(Path('cut.recovered.mcap')).duration_s:.2f} s")
