"""Joint friction compensation by an identified sigmoid (Gaz et al., RA-L 2019)."""

import math

from hal.compilation import compiled


@compiled
def friction_torque(dq, p1, p2, p3, scale, out):
    """Write the torque (7,), Nm, that overcomes the friction at dq: it has the sign of the velocity."""
    for i in range(7):
        rest = 1.0 / (1.0 + math.exp(-p2[i] * p3[i]))
        out[i] = scale * p1[i] * (1.0 / (1.0 + math.exp(-p2[i] * (dq[i] + p3[i]))) - rest)
