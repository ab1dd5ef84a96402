"""The fixed-size records that flow through the tick. Compiled code reads and writes their fields by name."""

import numpy as np

# One point of a reference of one arm. position m, rotation (3, 3) of T_world_ee, twist m/s rad/s, wrench N Nm,
# posture xi rad, dxi rad/s, beta rad/s^2
POINT = np.dtype(
    [
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("twist", "f8", 6),
        ("wrench_ff", "f8", 6),
        ("xi", "f8"),
        ("dxi", "f8"),
        ("beta", "f8"),
    ]
)

# What one arm is asked for in this tick: a point, and how hard to pursue it. velocity_weight scales the velocity
# feedback: 1 in the ante- and post-impact modes, gamma in the interim mode, 0 where a baseline removes it. stiffness
# N/m, Nm/rad, or 1/s^2 where acceleration_tasks is not 0
SETPOINT = np.dtype(
    [
        *POINT.descr,
        ("velocity_weight", "f8"),
        ("stiffness", "f8", 6),
        ("posture_gain", "f8"),
        ("acceleration_tasks", "i8"),
    ]
)

# What observing an arm takes and no state changes: where the end effector is on the last joint (m) and the base
# in the world, motor inertia kg m^2, friction (see FrictionParameters), the observer's gain, and the detector's bounds
OBSERVER_PARAMETERS = np.dtype(
    [
        ("face", "f8", 3),
        ("R_joint_ee", "f8", (3, 3)),
        ("R_world_base", "f8", (3, 3)),
        ("B_theta", "f8", 7),
        ("p1", "f8", 7),
        ("p2", "f8", 7),
        ("p3", "f8", 7),
        ("friction_scale", "f8"),
        ("gravity_share", "f8", 7),
        ("observer_gain_hz", "f8"),
        ("period_s", "f8"),
        ("force_low_n", "f8"),
        ("force_high_n", "f8"),
        ("velocity_m_s", "f8"),
        ("tare_n", "f8"),
        ("largest_tare_n", "f8"),
    ]
)

# What the tick of one arm works on. Names as in the papers; lower/upper bound ddq, tau_lower/tau_upper bound (14)
WORKSPACE = np.dtype(
    [
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("twist", "f8", 6),
        ("J", "f8", (6, 7)),
        ("dJdq", "f8", 6),
        ("M", "f8", (7, 7)),
        ("coriolis", "f8", 7),
        ("gravity", "f8", 7),
        ("friction", "f8", 7),
        ("Lambda_inverse", "f8", (6, 6)),
        ("sqrt_Lambda", "f8", (6, 6)),
        ("D", "f8", (6, 6)),
        ("H", "f8", (7, 7)),
        ("gradient", "f8", 7),
        ("lower", "f8", 7),
        ("upper", "f8", 7),
        ("tau_lower", "f8", 7),
        ("tau_upper", "f8", 7),
        ("ddq", "f8", 7),
        ("tau_previous", "f8", 7),
        ("force_world", "f8", 3),
        ("momentum_integral", "f8", 7),
        ("residual_previous", "f8", 7),
        ("observed", "i8"),
        # working memory of the compiled functions, so that none of them allocates
        ("factor", "f8", (7, 7)),
        ("rows", "f8", (6, 7)),
        ("symmetric", "f8", (6, 6)),
        ("vectors", "f8", (6, 6)),
        ("turns", "f8", (3, 2)),
        ("six", "f8", 6),
        ("seven", "f8", 7),
        ("relative", "f8", (3, 3)),
        ("turn", "f8", (3, 3)),
        ("three", "f8", 3),
    ]
)
