"""The monitor's state and tuning as fixed-size records, for arms of any number of joints, and what it can say."""

from enum import IntEnum

import numpy as np

from hal.compilation import fields

LONGEST_WINDOW = 63  # ticks: the largest m_max


class Verdict(IntEnum):
    """Impact of Algorithm 1. It comes a horizon (xi) after the last impact and, once unexpected, stays."""

    NONE = 0
    EXPECTED = 1
    UNEXPECTED = 2


class Reason(IntEnum):
    """The first condition that was not met."""

    NONE = 0
    TIME = 1  # (10): too early or too late
    CONFIGURATION = 2  # (11): in another place
    SPACING = 3  # (12): too long after the impact before
    ENVELOPE = 4  # (17): the motion after it is another one
    NO_IMPACT = 5  # (10) cannot be met any more
    # of a pair of arms (pair.py)
    ONE_SIDE = 6  # one arm has hit, the other one has not
    LOAD = 7  # both pads together do not feel what they should
    PAIR_TIME = 8  # the later arm has hit too early or too late: what is in between is wider or narrower
    STOPPED = 9  # a fault has ended the trial at the impact, before all was decided


def parameters_dtype(joints: int) -> np.dtype:
    """Return the record of a tuning: rates Nm/s, times ns, decay 1/s, rad, rad/s."""
    return np.dtype(
        [
            ("residual_rate", "f8", (joints,)),
            *fields("f8", "decay configuration velocity"),
            *fields("i8", "window delay_ns time_ns horizon_ns spacing_ns"),
        ]
    )


def monitor_dtype(joints: int) -> np.dtype:
    """Return the record of the state. All zero: nothing seen, nothing expected (see `monitor_expect`).

    instantaneous, post_impact and verdict are of Verdict; the first two are known before the verdict is. margin: 1
    where all is as meant, 0 at the bound of the nearest condition, negative beyond it.
    """
    return np.dtype(
        [
            # what is expected
            *fields("i8", "expecting t_d_ns"),
            ("q_d", "f8", (joints,)),
            # what is said; joint: of the envelope that left zero outside, -1 for other reasons
            *fields("i8", "verdict reason joint"),
            ("margin", "f8"),
            *fields("i8", "instantaneous post_impact"),
            # impacts (9); impact: 1 in the tick of one; since_impact: ticks
            *fields("i8", "impact impacts t_first_ns t_impact_ns since_impact"),
            # signals: r Nm, its rate (8) Nm/s, e_vel (14) and its envelope (16) rad/s
            *fields("f8", "rate error lower upper", joints),
            # memory
            *fields("i8", "ticks t_ns"),
            ("residual", "f8", (joints,)),
            ("head", "i8"),
            ("history", "f8", (LONGEST_WINDOW + 1, joints)),
            ("instantaneous_margin", "f8"),
            ("window_margin", "f8"),  # since the last impact; above 1 where zero lies deep inside the envelopes
        ]
    )
