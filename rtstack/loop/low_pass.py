"""The optional low-pass of the commanded torque: readOnce and writeOnce of libfranka filter nothing."""

import math

from hal.compilation import compiled
from hal.limits import CONTROL_PERIOD_S


def low_pass_share(cutoff_hz: float) -> float:
    """Return the share of the way to a new torque that is gone in one tick (libfranka, lowpass_filter.h); 1: all."""
    if cutoff_hz <= 0.0:
        return 1.0
    return CONTROL_PERIOD_S / (CONTROL_PERIOD_S + 1.0 / (2.0 * math.pi * cutoff_hz))


@compiled
def low_pass(samples, workspaces, share):
    """Move samples[0].tau_desired to where it is `share` of the way from the last applied torque: never a larger step.

    What is no number stays none: the judge sees it.
    """
    desired, last = samples[0].tau_desired, workspaces[0].tau_previous
    for i in range(7):
        desired[i] = last[i] + share * (desired[i] - last[i])
