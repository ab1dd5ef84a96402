"""A variant of a robot: a Franka Research 3 that may use half its joints' speed, as on a first day in a lab."""

from dataclasses import replace

from hal.robots import FR3
from hal.robots.description import described

_LIMITS = replace(FR3.limits, dq_max=0.5 * FR3.limits.dq_max)
_JOINTS = tuple(f"joint{number}" for number in range(1, 8))

half_speed = replace(
    FR3,
    reference="half_speed",
    title="Franka Research 3 at half speed",
    limits=_LIMITS,
    urdf=described(FR3.urdf, "half_speed", _JOINTS, "link8", _LIMITS),
    sources={**FR3.sources, "limits.dq_max": "half of the vendor's, for practice"},
)
