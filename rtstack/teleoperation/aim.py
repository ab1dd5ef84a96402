"""Requests become goals: checked, kept in reach, and left alone where they jump. Compiled; no allocation."""

import math

import numpy as np

from hal.compilation import compiled
from rtstack.teleoperation.follower import coordinates
from rtstack.teleoperation.reach import AHEAD_M, AHEAD_RAD, GAP_M, TILT_RAD

LENGTH_TOLERANCE = 1e-3  # of a quaternion

# working memory of an arm's request
AIM = np.dtype([("position", "f8", 3), ("rotation", "f8", (3, 3)), ("goal", "f8", 6), ("usable", "i8")])


@compiled
def _rotation(pose, out):
    """Write the rotation of the quaternion wxyz in pose[3:7], normalised first."""
    n = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    w, x, y, z = pose[3] / n, pose[4] / n, pose[5] / n, pose[6] / n
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[0, 1] = 2.0 * (x * y - w * z)
    out[0, 2] = 2.0 * (x * z + w * y)
    out[1, 0] = 2.0 * (x * y + w * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[1, 2] = 2.0 * (y * z - w * x)
    out[2, 0] = 2.0 * (x * z - w * y)
    out[2, 1] = 2.0 * (y * z + w * x)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@compiled
def _usable(pose):
    """Whether a pose (7,) is finite, and its quaternion of length one."""
    square = 0.0
    for i in range(7):
        if not math.isfinite(pose[i]):
            return False
        if i >= 3:
            square += pose[i] ** 2
    return abs(math.sqrt(square) - 1.0) <= LENGTH_TOLERANCE


@compiled
def aim(poses, followers, aims, lower, upper):
    """Make the poses (2, 7) of (left, right) the followers' goals, inside of the box; return how many were not taken.

    A pose that is no pose, or is further ahead of its arm's command than AHEAD_M, leaves the goal as it is.
    """
    missed = 0
    for side in range(2):
        a = aims[side, 0]
        a.usable = _usable(poses[side])
        for i in range(3):
            x = poses[side, i] if a.usable else followers[side, 0].goal[i]
            a.position[i] = min(max(x, lower[i]), upper[i])
    lacking = GAP_M - (aims[0, 0].position[1] - aims[1, 0].position[1])
    if lacking > 0.0:
        aims[0, 0].position[1] += 0.5 * lacking
        aims[1, 0].position[1] -= 0.5 * lacking
    for side in range(2):
        a = aims[side, 0]
        if not a.usable:
            missed += 1
            continue
        _rotation(poses[side], a.rotation)
        coordinates(followers[side], a.position, a.rotation, a.goal)
        tilt = math.sqrt(a.goal[3] ** 2 + a.goal[4] ** 2 + a.goal[5] ** 2)
        far = 0.0
        turned = 0.0
        command = followers[side, 0].command
        for i in range(3):
            if tilt > TILT_RAD:
                a.goal[3 + i] *= TILT_RAD / tilt
            far += (a.goal[i] - command[i]) ** 2
            turned += (a.goal[3 + i] - command[3 + i]) ** 2
        if far > AHEAD_M**2 or turned > AHEAD_RAD**2:
            missed += 1
            continue
        for i in range(6):
            followers[side, 0].goal[i] = a.goal[i]
    return missed
