"""Two arms from one PC, in one loop: each is answered when its own state has come.

Two control boxes have two clocks. `shared_clock` is for simulated arms in lockstep, which share one; leave it out for
real ones.
"""

from contextlib import closing

import numpy as np

from hal.fci import open_pair
from rtstack.testing import serve_arms

with serve_arms() as served, closing(open_pair(served.left, served.right, shared_clock=True)) as pair:
    pair.start()  # torque control of both, within the 20 packets that a robot waits
    first, answered = {}, dict.fromkeys(pair.arms, 0)
    while min(answered.values()) < 500:
        ready = pair.wait()  # the mask of the arms whose state is there
        for bit, arm in pair.arms.items():
            if ready & bit:
                state = arm.read()
                start = first.setdefault(bit, state.q.copy())
                arm.write(50.0 * (start - state.q) - 5.0 * state.dq)
                answered[bit] += 1
    pair.stop()
    for bit, arm in pair.arms.items():
        moved = np.abs(arm.read().q - first[bit]).max()
        print(f"arm {bit}: {answered[bit]} states answered, moved by {1e3 * moved:.2f} mrad at most")
