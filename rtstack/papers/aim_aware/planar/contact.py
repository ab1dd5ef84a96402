"""Contact of a corner: the exponentially extended Hunt-Crossley law (the paper's [35], [36])."""

import math

from hal.compilation import compiled


@compiled
def contact_force(depth, rate, stiffness, exponent, damping):
    """Return F = k d^n e^(lambda d-dot), N, for depth m and its rate m/s; 0 out of contact.

    A mass m that hits at v is stopped at the depth d with k d^(n+1) / (n+1) = m (1 - e^(-lambda v) (1 + lambda v)) /
    lambda^2, and never pulled.
    """
    if depth <= 0.0:
        return 0.0
    return stiffness * depth**exponent * math.exp(damping * rate)
