"""What a tick says about itself: one fixed-size record a topic, the same in the tick, the rings, the log and the plots.

The records are the single source of the log's schema (rtstack.log.schema) and of the live view. Units are SI,
wrenches and twists are [linear, angular] along the world's axes about the pad's face; `wrench_desired` is the wrench
that the controller wants to act on the end effector.
"""

from enum import IntEnum, StrEnum

import numpy as np

from hal.state import ARM_STATE
from hal.tracker import OBJECT_POSE

SIDES: tuple[str, str] = ("left", "right")


class Mode(IntEnum):
    """What the controller is doing. The three impact modes are the paper's."""

    IDLE = 0
    TELEOPERATION = 1
    ANTE_IMPACT = 2
    INTERIM = 3
    POST_IMPACT = 4
    STOPPING = 5
    STOPPED = 6
    HOLDING = 7  # reactions to an impact that was not meant
    RETREATING = 8


class QpStatus(IntEnum):
    """How the torque of this tick was found."""

    NOT_USED = 0
    UNCONSTRAINED = 1  # the unconstrained minimiser satisfies every limit
    SOLVED = 2  # the solver ran, and its answer satisfies the optimality conditions
    INFEASIBLE = 3
    ITERATIONS_EXHAUSTED = 4
    WRONG_ANSWER = 5  # the solver says solved, the optimality conditions say no


class QpSolver(StrEnum):
    """Which library answers."""

    PROXQP = "proxqp"
    DAQP = "daqp"


class Reaction(StrEnum):
    """What an unexpected verdict leads to."""

    CONTINUE = "continue"  # nothing but a mark in log and result
    STOP = "stop"  # the judge's controlled stop
    HOLD = "hold"  # the setpoint stays where it is
    RETREAT = "retreat"  # back the way it came, unless the object may have been lifted: then it holds


# hal's state and the torques: what the controller wanted, and what the safety judge let through
ARM_SAMPLE = np.dtype([*ARM_STATE.descr, ("tau_desired", "f8", 7), ("tau_applied", "f8", 7)])

CONTROL_SAMPLE = np.dtype(
    [
        ("t_ns", "i8"),
        ("mode", "i8"),  # Mode
        ("gamma", "f8"),  # blending parameter (29), 0 outside the interim mode's ramp, 1 after it
        ("wrench_desired", "f8", 6),  # (5), (22), (27): N, Nm
        ("pose_ref", "f8", 7),  # T_world_ee: position m, quaternion wxyz
        ("twist_ref", "f8", 6),  # m/s, rad/s
        ("wrench_ff", "f8", 6),  # feedforward part of wrench_desired
        ("beta", "f8"),  # posture acceleration (10), (24), (31), rad/s^2
        ("qp_status", "i8"),  # QpStatus
        ("qp_iterations", "i8"),
        ("momentum_residual", "f8", 7),  # Nm, sign of tau_ext_hat_filtered
        ("residual_rate", "f8", 7),  # Nm/s
        ("force_norm", "f8"),  # (33), over both arms
        # of the aim-aware monitor (rtstack.monitor)
        ("impact_verdict", "i8"),  # Verdict of this arm
        ("impact_reason", "i8"),  # Reason
        ("impact_margin", "f8"),  # 1 as meant, 0 at the nearest bound
        ("pair_verdict", "i8"),  # Verdict of both arms and what is in between
        ("pair_reason", "i8"),
        ("pair_margin", "f8"),
    ]
)

TIMING_SAMPLE = np.dtype(
    [
        ("t_ns", "i8"),
        ("period_us", "f8"),
        ("compute_us", "f8"),
        ("lateness_us", "f8"),
        ("missed_deadlines", "i8"),
        ("pair_skew_us", "f8"),
    ]
)


class Level(IntEnum):
    """Severity of an event, as foxglove.Log counts it."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4
    FATAL = 5


# `name` says who speaks (mode, impact, verdict, safety, operator), `text` what; both ASCII, cut to fit
EVENT = np.dtype([("t_ns", "i8"), ("level", "i8"), ("name", "S24"), ("text", "S200")])

# topic -> record: the table from which rings, schema, log and live view are made
TOPICS: dict[str, np.dtype] = {
    "/left/arm": ARM_SAMPLE,
    "/right/arm": ARM_SAMPLE,
    "/left/control": CONTROL_SAMPLE,
    "/right/control": CONTROL_SAMPLE,
    "/timing": TIMING_SAMPLE,
    "/object/pose": OBJECT_POSE,
    "/events": EVENT,
}
