"""Hours of work: run trials in one process, and look at what may grow or fail: memory, missed ticks, outcomes.

python 29_hours.py 3600          # that many trials, with seeds from 1 on; a trial takes a second
`make program NAME=soak` does it with the whole stack, page and log process.
"""

import sys

import psutil

import rtstack

count = int(sys.argv[1]) if len(sys.argv) > 1 else 3
process = psutil.Process()
used = []
for seed in range(1, count + 1):
    result = rtstack.run_trial("ref.mcap", seed=seed)
    used.append(process.memory_info().rss / 2**20)
    outcome = "success" if result.success else result.failure_reason
    print(f"trial {seed}: {outcome}, {result.missed_deadlines} ticks missed, {used[-1]:.0f} MiB, "
          f"{process.num_fds()} descriptors")  # fmt: skip
print(f"memory grew by {used[-1] - used[len(used) // 2]:.1f} MiB in the second half")
