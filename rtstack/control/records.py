"""The fixed-size records that flow through the tick. Compiled code reads and writes their fields by name."""

import numpy as np

from hal.compilation import fields

POINT = np.dtype(
    [
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        *fields("f8", "twist wrench_ff", 6),
        *fields("f8", "xi dxi beta"),
    ]
)
"""One point of a reference of one arm: position m and rotation (3, 3) of T_world_ee, twist m/s rad/s, wrench_ff N Nm,
posture xi rad, dxi rad/s, beta rad/s^2."""

SETPOINT = np.dtype(
    [
        *POINT.descr,
        ("velocity_weight", "f8"),
        ("stiffness", "f8", 6),
        ("posture_gain", "f8"),
        ("acceleration_tasks", "i8"),
    ]
)
"""The setpoint of one arm in this tick: a POINT, and how hard to pursue it. velocity_weight scales the velocity
feedback: 1 in the ante- and post-impact modes, gamma in the interim mode, 0 where a baseline removes it. stiffness
N/m, Nm/rad, or 1/s^2 where acceleration_tasks is not 0."""

# What observing an arm takes and no state changes: where the end effector is on the last joint (m) and the base
# in the world, motor inertia kg m^2, friction (see FrictionParameters), the observer's gain, and the detector's bounds
OBSERVER_PARAMETERS = np.dtype(
    [
        ("face", "f8", 3),
        *fields("f8", "R_joint_ee R_world_base", 3, 3),
        *fields("f8", "B_theta p1 p2 p3 gravity_share", 7),
        *fields("f8", "friction_scale observer_gain_hz period_s"),
        *fields("f8", "force_low_n force_high_n velocity_m_s tare_n largest_tare_n"),
    ]
)

WORKSPACE = np.dtype(
    [
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("twist", "f8", 6),
        ("J", "f8", (6, 7)),
        ("dJdq", "f8", 6),
        ("M", "f8", (7, 7)),
        *fields("f8", "coriolis gravity friction", 7),
        *fields("f8", "Lambda_inverse sqrt_Lambda D", 6, 6),
        ("H", "f8", (7, 7)),
        *fields("f8", "gradient lower upper tau_lower tau_upper ddq tau_previous", 7),
        ("force_world", "f8", 3),
        *fields("f8", "momentum_integral residual_previous", 7),
        ("observed", "i8"),
        # working memory of the compiled functions, so that none of them allocates
        ("factor", "f8", (7, 7)),
        ("rows", "f8", (6, 7)),
        *fields("f8", "symmetric vectors", 6, 6),
        ("turns", "f8", (3, 2)),
        ("six", "f8", 6),
        ("seven", "f8", 7),
        *fields("f8", "relative turn", 3, 3),
        ("three", "f8", 3),
    ]
)
"""What the tick of one arm works on, along the world's axes: position m, rotation (3, 3), twist m/s rad/s and Jacobian
J (6, 7) of the pad's face, dJdq m/s^2 rad/s^2, M (7, 7) kg m^2, coriolis, gravity, friction and tau_previous (7,) Nm,
force_world (3,) N. lower, upper bound ddq; tau_lower, tau_upper bound (14) of the reference-spreading paper."""
