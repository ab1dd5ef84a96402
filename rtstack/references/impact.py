"""The impact that a reference aims at, as the monitor wants it: when, in which configuration, and what is to follow.

From a demonstration: joints at the nominal impact, joint velocities as the post-impact reference of (14), extended like
(16) to the time before T_p, and the force of both pads. From a plan: planned joints, velocities and forces.
"""

import numpy as np

from hal.base.arrays import Array
from rtstack.monitor.expected import ExpectedImpact

LIFTED_S = 0.6  # after the impact the object hangs in the air
CARRIED_SHARE = 0.35  # of its weight: what carrying adds or takes away at most
EARLIER_S = 0.1  # a trial meets the table earlier, where it has grabbed the object lower
NEAR_TABLE_M = 0.01  # a planned object that is not higher may stand on the table: arms sag, and it slips in the pads
SMOOTHING_S = 0.02  # on each side: what oscillates in the demonstration's velocities is no reference


def demonstrated_impact(
    q: Array, dq: Array, force: Array, impact: int, release: int, excluded: int, period_s: float
) -> ExpectedImpact:
    """Return the impact of a demonstration: q, dq (2, n, 7), force (2, n, 3) ON the pads, N, along the world's axes.

    impact, release: indices of T_r and of the release; excluded: Delta T_r in ticks, around T_r.
    """
    half = round(SMOOTHING_S / period_s)
    smooth = np.stack([_smooth(values, half) for values in dq])
    post = smooth.copy()
    post[:, : impact + excluded] = smooth[:, impact + excluded, None]
    # before the impact a pad feels what the estimate is off by
    bias = force[:, : max(1, impact - excluded)].mean(axis=1)
    net = -_smooth((force - bias[:, None]).sum(axis=0), half)
    before = slice(max(0, impact - 2 * half), max(1, impact - half))  # the detection is some ms behind the contact
    ante = dq[:, before].mean(axis=1)
    down = _set_down(net[:, 2], impact + round(LIFTED_S / period_s), release) - round(EARLIER_S / period_s)
    return ExpectedImpact(impact * period_s, q[:, impact].copy(), ante, post, net, down * period_s, release * period_s)


def planned_impact(
    q: Array, dq: Array, force: Array, height: Array, impact: int, release: int, period_s: float
) -> ExpectedImpact:
    """Return the impact of a plan: q, dq (2, n, 7), force (2, n, 3) ON the pads, N, along the world's axes; height (n,)
    m: of what is carried; impact: index of the first post-impact point, at which the velocities jump."""
    post = dq.copy()
    post[:, :impact] = dq[:, impact, None]
    lifted = height[impact:release] - height[impact]
    up = np.flatnonzero(lifted > min(NEAR_TABLE_M, 0.5 * lifted.max()))
    down = impact + int(up[-1]) - round(EARLIER_S / period_s)
    return ExpectedImpact(
        impact * period_s, q[:, impact].copy(), dq[:, impact - 1].copy(), post, -force.sum(axis=0), down * period_s,
        release * period_s,
    )  # fmt: skip


def _set_down(lift: Array, lifted: int, release: int) -> int:
    """Index at which an object that hangs in the air at `lifted` meets the table: what is lifted (n,), N, changes."""
    carried = lift[lifted:release]
    if len(carried) == 0:
        return release
    weight = np.median(carried[: len(carried) // 2 + 1])
    changed = np.flatnonzero(np.abs(carried - weight) > CARRIED_SHARE * abs(weight))
    return lifted + int(changed[0]) if len(changed) else release


def _smooth(values: Array, half: int) -> Array:
    """Mean over 2 half + 1 ticks of values (n, k), the ends held."""
    padded = np.concatenate([np.repeat(values[:1], half, axis=0), values, np.repeat(values[-1:], half, axis=0)])
    total = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), padded]), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)
