"""The impact that a motion aims at: when, in which configuration, and what follows. Made by rtstack.references."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class ExpectedImpact:
    """Arrays of n ticks from the start of the reference, arms (left, right).

    t_d_s: nominal impact; q_d (2, 7) rad; dq_ante (2, 7) rad/s just before it; dq_post (2, n, 7) rad/s; net_force (n,
    3): N along the world's axes, of the pads on the object, both arms together; set_down_s: until when it is carried;
    release_s: when it is let go.
    """

    t_d_s: float
    q_d: Array
    dq_ante: Array
    dq_post: Array
    net_force: Array
    set_down_s: float
    release_s: float
