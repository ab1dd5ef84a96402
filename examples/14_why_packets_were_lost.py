"""`communication_constraints_violation`: provoke it, see it come, and read whose lateness it was.

A robot counts answers that come too late. At 20 in a row it stops. Here a script of faults drops ours for 30 ms; on a
robot it is a busy PC or a cable. In a log of real arms `review_log(path).lateness` lays each late cycle to robot, wire
or host.
"""

from contextlib import closing
from pathlib import Path

from hal.errors import CommandRejected
from hal.fci import FciArm
from rtstack.testing import serve_arms

faults = Path("faults.toml")
faults.write_text('[[fault]]\nkind = "answers_lost"\narm = "left"\nat_s = 0.2\nduration_s = 0.03\n')

rates = []
with serve_arms(faults=faults) as served, closing(FciArm(served.left)) as arm:
    try:
        for _ in range(500):
            state = arm.read()
            rates.append(float(state.record["control_command_success_rate"][0]))
            arm.write(-5.0 * state.dq)
    except CommandRejected as stop:
        print(stop)
last = max(k for k, rate in enumerate(rates) if rate == 1.0)
print(f"every answer counted until state {last}; {len(rates) - last} states later {rates[-1]:.2f} of 100 did")
