"""Near a joint's limit the arm slows down instead of freezing: the limits are constraints of the controller's QP.

A policy draws both pads back for longer than the elbows can bend. Nothing stops: they go as far as they may, and hold.
"""

from pathlib import Path

import numpy as np

import rtstack
from hal.robots import FR3
from rtstack.log.reader import read_log
from rtstack.teleoperation.policy import Chunk


class DrawBack:
    """Both pads come towards the bases at 0.2 m/s, for four seconds."""

    def act(self, observation):
        if observation.t_s > 4.0:
            return Chunk(finished=True)
        poses = np.repeat(observation.pose_ref[None], 5, axis=0)
        poses[:, :, 0] -= 0.2 * 0.05 * np.arange(1, 6)[:, None]
        return Chunk(step_s=0.05, poses=poses)

    def close(self):
        pass


result = rtstack.run_policy(DrawBack(), log="back.mcap")
arm = read_log(Path("back.mcap")).topic("/left/arm")
room = np.minimum(arm["q"] - FR3.limits.q_lower, FR3.limits.q_upper - arm["q"])
tick, joint = np.unravel_index(room.argmin(), room.shape)
print(result.failure_reason or "no fault", f"after {result.duration_s:.1f} s")
print(f"nearest to its limit: joint {joint + 1}, by {room.min():.3f} rad, at {abs(arm['dq'][tick, joint]):.3f} rad/s")
