"""How long the loop takes: a robot leaves it some 300 us of each millisecond. Every tick is in the log.

`rtstack bench tick --ticks 300` measures the tick of both arms on your machine, without a trial.
"""

from pathlib import Path

import numpy as np

from rtstack.log.reader import read_log

BUDGET_US = 300.0

log = read_log(Path("trial.mcap"))
timing = log.topic("/timing")  # (ticks,) records
median, p99, worst = np.percentile(timing["compute_us"], (50, 99, 100))
print(f"from a state to its answer: {median:.0f} us median, {p99:.0f} us at p99, {worst:.0f} us at most")
print(f"{100 * np.mean(timing['compute_us'] <= BUDGET_US):.2f} % of {len(timing)} ticks within {BUDGET_US:.0f} us")
print("ticks missed:", int(timing["missed_deadlines"][-1]))
slow = np.argsort(timing["compute_us"])[-3:][::-1]
for k in slow:
    at_s = (timing["t_ns"][k] - log.start_ns) * 1e-9
    print(f"  {at_s:.3f} s: {timing['compute_us'][k]:.0f} us, {timing['period_us'][k]:.0f} us after the last tick")
