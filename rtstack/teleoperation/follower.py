"""From an operator's requests, 20 or so a second, to a command a tick: goals, and a filter. Compiled; no allocation.

A pose is six coordinates: the position, and the rotation vector from where the end effector began, so that poses can
be averaged. Three steps follow one another: a low-pass of which each half (m, rad) goes no faster than its
speed, a moving average over SMOOTH_S, and one over SOFT_S. An average of what is bounded is bounded, so that by
construction, for either half and any sequence of requests,

    |velocity| <= speed,  |acceleration| <= 2 speed / SMOOTH_S,  |jerk| <= 4 speed / (SMOOTH_S SOFT_S),

nothing overshoots, and SMOOTH_S + SOFT_S after the first step has stopped the command stands still. For a rotation the
speed bounds the angular velocity too: rotation vectors are never shorter than the turns that they stand for.
"""

import math

import numpy as np

from hal.compilation import compiled
from hal.limits import CONTROL_PERIOD_S
from rtstack.control.records import POINT
from rtstack.model.rotation import exp_so3, log_so3, multiply, transpose_multiply
from rtstack.teleoperation.reach import AHEAD_M, AHEAD_RAD, GAP_M, TILT_RAD, UNIT_TOLERANCE

LOW_PASS_S = 0.04  # fills the time between two requests of a page
SMOOTH_S = 0.1
SOFT_S = 0.05
BRAKING_S = SMOOTH_S + SOFT_S  # until a command that is stopped stands still
_SMOOTH, _SOFT = round(SMOOTH_S / CONTROL_PERIOD_S), round(SOFT_S / CONTROL_PERIOD_S)
_STEP = CONTROL_PERIOD_S / LOW_PASS_S

# One arm's filter: the pose at which it began, what is asked for, and the three steps. Coordinates (6,): m, rad.
FOLLOWER = np.dtype([
    ("origin", "f8", (3, 3)), ("goal", "f8", 6), ("followed", "f8", 6), ("smooth", "f8", (_SMOOTH, 6)),
    ("soft", "f8", (_SOFT, 6)), ("command", "f8", 6), ("velocity", "f8", 6), ("tick", "i8"),
    ("turn", "f8", (3, 3)), ("relative", "f8", (3, 3)), ("three", "f8", 3),
])  # fmt: skip


@compiled
def begin(followers, position, rotation):
    """Begin at rest at a position (3,), m, and rotation (3, 3), in the world."""
    f = followers[0]
    for i in range(3):
        for j in range(3):
            f.origin[i, j] = rotation[i, j]
    for i in range(6):
        x = position[i] if i < 3 else 0.0
        f.goal[i] = x
        f.followed[i] = x
        f.command[i] = x
        f.velocity[i] = 0.0
        for k in range(_SMOOTH):
            f.smooth[k, i] = x
        for k in range(_SOFT):
            f.soft[k, i] = x
    f.tick = 0


@compiled
def coordinates(followers, position, rotation, out):
    """Write the coordinates (6,) of a pose, m and rad."""
    f = followers[0]
    transpose_multiply(f.origin, rotation, f.relative)
    log_so3(f.relative, f.three)
    for i in range(3):
        out[i] = position[i]
        out[3 + i] = f.three[i]


@compiled
def hold(followers):
    """Ask for no more than what the first step has reached: the commands of (arms, 1) brake within BRAKING_S."""
    for side in range(followers.shape[0]):
        f = followers[side, 0]
        for i in range(6):
            f.goal[i] = f.followed[i]


@compiled
def _approach(f, start, speed):
    """Low-pass one half of the coordinates, no faster than `speed` a second."""
    square = 0.0
    for i in range(start, start + 3):
        square += (f.goal[i] - f.followed[i]) ** 2
    distance = math.sqrt(square)
    if distance == 0.0:
        return
    share = min(_STEP, speed * CONTROL_PERIOD_S / distance)
    for i in range(start, start + 3):
        f.followed[i] += share * (f.goal[i] - f.followed[i])


@compiled
def advance(followers, speed, turn_speed):
    """One tick further towards the goal, at most `speed` m/s and `turn_speed` rad/s."""
    f = followers[0]
    _approach(f, 0, speed)
    _approach(f, 3, turn_speed)
    smooth_at = f.tick % _SMOOTH
    soft_at = f.tick % _SOFT
    f.tick += 1
    for i in range(6):
        f.smooth[smooth_at, i] = f.followed[i]
        mean = 0.0
        for k in range(_SMOOTH):
            mean += f.smooth[k, i] - f.followed[i]
        f.soft[soft_at, i] = f.followed[i] + mean / _SMOOTH
        mean = 0.0
        for k in range(_SOFT):
            mean += f.soft[k, i] - f.followed[i]
        command = f.followed[i] + mean / _SOFT
        f.velocity[i] = (command - f.command[i]) / CONTROL_PERIOD_S
        f.command[i] = command


@compiled
def write_point(followers, points):
    """Write the command as a point's position, rotation and twist, along the world's axes."""
    f = followers[0]
    point = points[0]
    rho = f.command[3:6]
    rate = f.velocity[3:6]
    exp_so3(rho, 1.0, f.turn)
    multiply(f.origin, f.turn, point.rotation)
    square = rho[0] ** 2 + rho[1] ** 2 + rho[2] ** 2
    angle = math.sqrt(square)
    # right Jacobian of SO(3): angular velocity along the body's axes from the rate of the rotation vector
    if angle > 1e-3:
        a = (1.0 - math.cos(angle)) / square
        b = (angle - math.sin(angle)) / (square * angle)
    else:
        a = 0.5
        b = 1.0 / 6.0
    dot = rho[0] * rate[0] + rho[1] * rate[1] + rho[2] * rate[2]
    for i in range(3):
        j = (i + 1) % 3
        m = (i + 2) % 3
        cross = rho[j] * rate[m] - rho[m] * rate[j]
        f.three[i] = rate[i] - a * cross + b * (rho[i] * dot - square * rate[i])
    for i in range(3):
        point.position[i] = f.command[i]
        point.twist[i] = f.velocity[i]
        point.twist[3 + i] = (
            point.rotation[i, 0] * f.three[0] + point.rotation[i, 1] * f.three[1] + point.rotation[i, 2] * f.three[2]
        )


def compile_follower(arms: int) -> None:
    """Compile what a tick of so many arms calls, before the first one."""
    followers, points, six = np.zeros((arms, 1), FOLLOWER), np.zeros((arms, 1), POINT), np.zeros(6)
    begin(followers[0], six[:3], np.eye(3))
    coordinates(followers[0], six[:3], np.eye(3), six)
    hold(followers)
    advance(followers[0], 0.1, 0.1)
    write_point(followers[0], points[0])


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
    return abs(math.sqrt(square) - 1.0) <= UNIT_TOLERANCE


@compiled
def aim(poses, followers, aims, lower, upper):
    """Make the poses (arms, 7) the followers' goals, inside of the box; return how many were not taken.

    Two pads are kept apart. A pose that is none, or is further ahead of its arm's command than AHEAD_M, leaves the goal
    as it is.
    """
    missed = 0
    arms = aims.shape[0]
    for side in range(arms):
        a = aims[side, 0]
        a.usable = _usable(poses[side])
        for i in range(3):
            x = poses[side, i] if a.usable else followers[side, 0].goal[i]
            a.position[i] = min(max(x, lower[i]), upper[i])
    if arms == 2:
        lacking = GAP_M - (aims[0, 0].position[1] - aims[1, 0].position[1])
        if lacking > 0.0:
            aims[0, 0].position[1] += 0.5 * lacking
            aims[1, 0].position[1] -= 0.5 * lacking
    for side in range(arms):
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
